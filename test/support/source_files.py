"""What the checks of this folder share: the project's files, and C++ text without comments and strings."""
import pathlib
import re
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
CANNOT_RUN_HERE = 77


def tracked_files():
    """Paths relative to ROOT of all files that git knows or would add; None outside a git checkout."""
    command = ['git', '-C', str(ROOT), 'ls-files', '-z', '--cached', '--others', '--exclude-standard']
    try:
        names = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    except (OSError, subprocess.CalledProcessError):
        return None
    return sorted(pathlib.Path(name) for name in names.split('\0') if name and (ROOT / name).is_file())


def cpp_files(*folders):
    """Absolute paths of the C++ files below the given folders of ROOT."""
    found = []
    for folder in folders:
        found += [path for path in (ROOT / folder).rglob('*') if path.suffix in ('.h', '.hpp', '.cpp')]
    return sorted(found)


_COMMENT_OR_STRING = re.compile(r'//[^\n]*|/\*.*?\*/|"(?:\\.|[^"\\\n])*"|\'(?:\\.|[^\'\\\n])+\'', re.DOTALL)


def without_comments_and_strings(text):
    """`text` with both blanked out; line numbers stay."""
    def blank(match):
        lines = '\n' * match.group().count('\n')
        return lines if match.group().startswith('/') else '""' + lines
    return _COMMENT_OR_STRING.sub(blank, text)


def finish(problems, looked_at):
    """Prints the problems and ends the program. Having looked at nothing is a problem too."""
    if not looked_at:
        problems = ['found nothing to look at']
    for problem in problems:
        print(problem)
    print('%d looked at, %d problems' % (looked_at, len(problems)))
    sys.exit(1 if problems else 0)


def skip(reason):
    print('skipped: ' + reason)
    sys.exit(CANNOT_RUN_HERE)
