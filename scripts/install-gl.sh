#!/bin/sh
# Make sure that offscreen OpenGL (EGL) can be loaded; as root on Debian or Ubuntu install it, else print the command.
# Never fails: without OpenGL compiled code draws the face-ID buffers (films and stills need OpenGL).
instead='compiled code judges the pictures, and there are no films'
have() { ldconfig -p 2>/dev/null | grep -q "$1"; }
if have 'libEGL\.so\.1' && have 'libGL\.so\.1'; then exit 0; fi
if ! command -v apt-get >/dev/null 2>&1; then
    echo "Offscreen OpenGL is missing (libEGL.so.1, libGL.so.1). Install your system's Mesa EGL and GL libraries; until then"
    echo "$instead."
    exit 0
fi
if [ "$(id -u)" = 0 ]; then
    echo "Installing offscreen OpenGL: libegl1 libgl1 (about 220 MB with Mesa) ..."
    { apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq libegl1 libgl1; } >/dev/null 2>&1 && exit 0
    echo "That did not work; $instead. To try again: apt-get install libegl1 libgl1"
    exit 0
fi
echo "Offscreen OpenGL is missing; until it is installed $instead. Install it with:"
echo "    sudo apt-get install libegl1 libgl1"
