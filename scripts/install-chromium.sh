#!/bin/sh
# Make sure that there is a Chromium and its driver, by which the tests open reports; as root on Debian or Ubuntu install them,
# else print the command. Never fails: without them those tests are skipped.
if command -v chromedriver >/dev/null 2>&1; then exit 0; fi
if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null 2>&1; then
    echo "Installing chromium and chromium-driver ..."
    { apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq chromium chromium-driver; } >/dev/null 2>&1 \
        && exit 0
fi
echo "There is no chromedriver; the tests that open reports in a browser are skipped. Install your system's Chromium and its"
echo "driver, on Debian:"
echo "    sudo apt-get install chromium chromium-driver"
