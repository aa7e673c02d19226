#!/bin/sh
# The tests open a report in Chromium.  Where it cannot be installed they are skipped and say so.
command -v chromium >/dev/null && exit 0
if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    export DEBIAN_FRONTEND=noninteractive
    apt-get update -qq && apt-get install -y -qq --no-install-recommends chromium >/dev/null && exit 0
fi
echo "No chromium here, so that no test opens the report in a browser. To have them: sudo apt-get install chromium" >&2
