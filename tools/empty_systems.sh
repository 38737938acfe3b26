#!/bin/bash
# Test the installation that README describes, and solen outside its clone, on minimal systems without compiler and headers.
#
#   sudo tools/empty_systems.sh FOLDER [bookworm] [trixie]
#
# installs a minimal Debian 12 (Python 3.11) and Debian 13 (Python 3.13) in FOLDER with debootstrap, clones the last commit
# of this repository into each, and prints each step with its result, its CPU seconds and its log file. It requires root,
# because it mounts folders and uses chroot, and debootstrap, a network, 5 GB of disk per system and half an hour of CPU.
# pip is configured as on this system: with its PIP_* variables, its configuration files, and the files and folders that
# these name. A second call keeps the systems and clones the repository again. The exit code is 1 if a step failed.

set -u
here=$(cd "$(dirname "$0")/.." && pwd)
folder=${1:?specify a folder for the systems: tools/empty_systems.sh FOLDER}
shift
[ "$(id -u)" = 0 ] || { echo "tools/empty_systems.sh requires root: it mounts folders and uses chroot" >&2; exit 2; }
command -v debootstrap > /dev/null || { echo "tools/empty_systems.sh requires debootstrap; apt install debootstrap" >&2; exit 2; }
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
    parent=$(dirname "$path")  # a package index in a folder names files in that folder's parent
    mkdir -p "$system$parent"
    if [ -f "$path" ]; then cp -L "$path" "$system$path"; fi
    if [ -d "$path" ] && ! [ -d "$system$path" ]; then mount -o ro --bind "$parent" "$system$parent"; fi
  done
}

leave() {
  awk -v inside="$system/" 'index($2, inside) == 1 { print $2 }' /proc/mounts | sort -r | while read -r mount_point; do umount "$mount_point"; done
}

inside() {
  readarray -t variables < <(env | grep '^PIP_')
  chroot "$system" env -i HOME="$HOME" TERM=dumb PATH=/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin "${variables[@]}" /bin/bash -ec "$1"
}

# step NAME COMMAND: runs the command, whose output goes to a log file
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
  rm -rf "$system$HOME/solen" "$system$HOME/outside"
  mkdir -p "$system$HOME"
  git clone -q "$here" "$system$HOME/solen"
  chown -R 0:0 "$system$HOME/solen"
  mkdir "$system$HOME/outside"

  step "no compiler, no headers" '! command -v cc gcc g++ clang && ! ls /usr/include/python3*'
  if ! inside 'python3 -c "import ensurepip"' > /dev/null 2>&1; then
    step "make reports that python3-venv is missing" '! make demo > output 2>&1; cat output; grep "apt install python3-venv" output'
    step "apt install python3-venv" 'apt-get -qq update; apt-get -qq install --no-install-recommends python3-venv'
  fi
  step "make demo" 'make demo; test -s demo-out/report.html'
  step "make demo, again" 'make demo'
  step "make setup, every package from a wheel" 'PIP_ONLY_BINARY=:all: make setup'
  step "sources compile without a warning" '.venv/bin/python -W error -m compileall -q -f src tests tools examples'
  step "README, quickstart and tutorials" 'make test PYTEST_ARGS="-n 0 tests/house/test_documents.py"'
  step "tests of the command line and the repository" 'make test PYTEST_ARGS="tests/cli tests/house --ignore tests/house/test_documents.py"'

  step "wheel and source distribution" 'cd ../outside; python3 -m venv builds; builds/bin/pip install -q build; builds/bin/python -m build -o dist ../solen'
  for kind in whl tar.gz; do
    step "latest packages with the .$kind" "cd ../outside; python3 -m venv $kind; . $kind/bin/activate; pip install dist/*.$kind; pip check
      solen doctor; solen project examples --out $kind/samples; solen run $kind/samples/sensor.toml --out $kind/results"
  done
  step "every command that solen doctor prints" 'cd ../outside; . whl/bin/activate; solen doctor | sed -n "s/.*; pip install/pip install/p" > commands; cat commands
    test -s commands; . ./commands; pip check; solen doctor > report; cat report; ! grep missing report'
  leave
  trap - EXIT
done
exit $failed
