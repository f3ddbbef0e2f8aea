#!/bin/sh
# Look for known vulnerabilities of the packages in a virtual environment: audit.sh FOLDER_OF_ITS_PROGRAMS.
# Ends with 0 where none is known, 1 where some are, and 2 where nothing could be checked.
bin=$1
fetch='import sys, urllib.request; urllib.request.urlopen(sys.argv[1], timeout=10)'
if "$bin/python" -c "$fetch" https://pypi.org/pypi/pip/json 2>/dev/null; then
    service=pypi
elif "$bin/python" -c "$fetch" https://api.osv.dev/v1/vulns/PYSEC-2023-228 2>/dev/null; then
    service=osv
else
    echo "No advisory service can be reached (pypi.org, api.osv.dev): nothing was checked. Run make audit where one can be."
    exit 2
fi
if [ ! -x "$bin/pip-audit" ] &&
    ! "$bin/python" -m pip install --quiet --disable-pip-version-check 'pip-audit>=2.7'; then
    echo "pip-audit cannot be installed: nothing was checked; see the messages above."
    exit 2
fi
exec "$bin/pip-audit" --local --skip-editable --vulnerability-service "$service"
