#!/bin/sh
# Make a virtual environment: make-venv.sh PYTHON FOLDER. Never removes a folder that it did not make.
python=$1
folder=$2
if [ -e "$folder" ]; then
    echo "$folder exists but is no virtual environment; move it away or choose another: make run VENV=/path/to/new"
    exit 1
fi
if "$python" -c 'import ensurepip' 2>/dev/null; then
    exec "$python" -m venv "$folder"
fi
# Debian and Ubuntu ship the module that makes environments as a package of its own.
if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null 2>&1; then
    version=$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
    echo "Installing python$version-venv ..."
    { apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq "python$version-venv"; } >/dev/null 2>&1 &&
        exec "$python" -m venv "$folder"
fi
echo "Python's module ensurepip is missing. On Debian and Ubuntu install it with: sudo apt-get install python3-venv"
exit 1
