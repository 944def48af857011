# Shared by the scripts of this folder; sourced, not run.
set -euo pipefail

# Debian's own python must come before any other one: catkin's CMake files and the ROS tools need its modules.
export PATH=/usr/bin:$PATH

root_dir=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd -P)

say() { printf '\n== %s\n' "$*"; }
fail() { printf 'error: %s\n' "$*" >&2; exit 1; }

# needs_value OPTION [VALUE ...]: ends the script where no value follows the option.
needs_value() {
  case ${2:-} in
    ''|-*) printf 'error: %s needs a value (see --help)\n' "$1" >&2; exit 2 ;;
  esac
}

# Makes the programs and launch files of a build known to this shell. The setup files of catkin read unset variables.
source_devel() {
  local setup=$1/devel/setup.bash
  [ -f "$setup" ] || fail "no $setup: run scripts/build first"
  set +u
  # shellcheck source=/dev/null
  source "$setup"
  set -u
  export PATH=/usr/bin:$PATH
}

# Folder of recorded data (with euroc/ in it); empty where there is none.
if [ -z "${AUTOCAL_VIO_DATA:-}" ] && [ -d "$root_dir/../shared/data" ]; then
  AUTOCAL_VIO_DATA=$(cd "$root_dir/../shared/data" && pwd)
fi
export AUTOCAL_VIO_DATA=${AUTOCAL_VIO_DATA:-}
