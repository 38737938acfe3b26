#!/bin/bash
# Try README's start, and solen beside a clone, on systems that hold nothing but what README names: no compiler, no headers.
#
#   sudo tools/empty_systems.sh FOLDER [bookworm] [trixie]
#
# makes a minimal Debian 12 (Python 3.11) and 13 (Python 3.13) in FOLDER with debootstrap, clones the last commit of this
# repository into each, and prints each step with its result, its CPU seconds and its log. Only root may do this: it mounts
# folders and changes the root of processes. It needs debootstrap, a network, 5 GB a system and half an hour of CPU. pip
# there is configured as it is here: PIP_* variables, pip's files, and the files and folders that these name.
# A second call keeps the systems and clones anew. Exit code 1 if a step failed.

set -u
here=$(cd "$(dirname "$0")/.." && pwd)
folder=${1:?name a folder for the systems: tools/empty_systems.sh FOLDER}
shift
[ "$(id -u)" = 0 ] || { echo "tools/empty_systems.sh needs root: it mounts folders and changes the root" >&2; exit 2; }
command -v debootstrap > /dev/null || { echo "tools/empty_systems.sh needs debootstrap; apt install debootstrap" >&2; exit 2; }
mkdir -p "$folder"
folder=$(cd "$folder" && pwd)
failed=0

configuration() {
  files=$(ls /etc/pip.conf "$HOME/.config/pip/pip.conf" "$HOME/.pip/pip.conf" 2> /dev/null)
  echo "$files"
  { [ -z "$files" ] || cat $files; env | grep '^PIP_'; } | grep -oE '(^|[ =]|file://)/[^ ]+' | sed -E 's#^([ =]|file://)##' | sort -u
}

enter() {
  mount -t proc proc "$system/proc"
  mkdir -p "$system/dev/shm" "$system/dev/pts"
  mount -t tmpfs tmpfs "$system/dev/shm"
  mount -t devpts -o newinstance,ptmxmode=0666 devpts "$system/dev/pts"
  cp -L /etc/resolv.conf "$system/etc/resolv.conf"
  for path in $(configuration); do
    around=$(dirname "$path")  # an index in a folder names files beside it
    mkdir -p "$system$around"
    if [ -f "$path" ]; then cp -L "$path" "$system$path"; fi
    if [ -d "$path" ] && ! [ -d "$system$path" ]; then mount -o ro --bind "$around" "$system$around"; fi
  done
}

leave() {
  awk -v inside="$system/" 'index($2, inside) == 1 { print $2 }' /proc/mounts | sort -r | while read -r at; do umount "$at"; done
}

inside() {
  readarray -t variables < <(env | grep '^PIP_')
  chroot "$system" env -i HOME="$HOME" TERM=dumb PATH=/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin "${variables[@]}" /bin/bash -ec "$1"
}

# step NAME COMMAND: what it prints goes to its log
step() {
  log=$logs/$(echo "$1" | tr -c '[:alnum:]\n' -).log
  result=passed
  TIMEFORMAT='%U'
  { cpu_s=$( { time inside "cd ~/solen; $2" > "$log" 2>&1; } 2>&1; exit $? ); } || { result=FAILED; failed=1; }
  printf '%-8s  %-6s %8s s CPU  %s: %s\n' "$release" "$result" "$cpu_s" "$1" "$log"
}

for release in ${*:-bookworm trixie}; do
  system=$folder/$release
  logs=$folder/$release-logs
  mkdir -p "$logs"
  if [ ! -e "$system/etc/debian_version" ]; then
    debootstrap --variant=minbase --include=python3,make,git,ca-certificates "$release" "$system" > "$logs/debootstrap.log" 2>&1 ||
      { echo "$release: debootstrap failed; see $logs/debootstrap.log" >&2; exit 1; }
  fi
  trap leave EXIT
  enter
  rm -rf "$system$HOME/solen" "$system$HOME/beside"
  mkdir -p "$system$HOME"
  git clone -q "$here" "$system$HOME/solen"
  chown -R 0:0 "$system$HOME/solen"
  mkdir "$system$HOME/beside"

  step "no compiler, no headers" '! command -v cc gcc g++ clang && ! ls /usr/include/python3*'
  if ! inside 'python3 -c "import ensurepip"' > /dev/null 2>&1; then
    step "a line says that python3-venv is missing" '! make demo > lines 2>&1; cat lines; grep "apt install python3-venv" lines'
    step "apt install python3-venv" 'apt-get -qq update; apt-get -qq install --no-install-recommends python3-venv'
  fi
  step "make demo" 'make demo; test -s demo-out/report.html'
  step "make demo, again" 'make demo'
  step "make setup, every package from a wheel" 'PIP_ONLY_BINARY=:all: make setup'
  step "sources compile without a warning" '.venv/bin/python -W error -m compileall -q -f src tests tools examples'
  step "README, quickstart and tutorials" 'make test PYTEST_ARGS="-n 0 tests/house/test_documents.py"'
  step "tests of the command line and of the house" 'make test PYTEST_ARGS="tests/cli tests/house --ignore tests/house/test_documents.py"'

  step "wheel and source distribution" 'cd ../beside; python3 -m venv builds; builds/bin/pip install -q build; builds/bin/python -m build -o dist ../solen'
  for kind in whl tar.gz; do
    step "newest packages around the .$kind" "cd ../beside; python3 -m venv $kind; . $kind/bin/activate; pip install dist/*.$kind; pip check
      solen doctor; solen project examples --out $kind/samples; solen run $kind/samples/sensor.toml --out $kind/results"
  done
  step "every command that solen doctor prints" 'cd ../beside; . whl/bin/activate; solen doctor | sed -n "s/.*; pip install/pip install/p" > commands; cat commands
    test -s commands; . ./commands; pip check; solen doctor > state; cat state; ! grep missing state'
  leave
  trap - EXIT
done
exit $failed
