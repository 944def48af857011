#!/usr/bin/python3
"""summarize_tests.py TITLE=RESULTS_DIR...

Reads what ctest runs left in their results folders (ctest.xml and the tests' own result files), prints a table of each
run, the figures that system tests printed and the output of what failed, and closes with `N passed, N failed`.
Exit 0 only if something passed and nothing failed.
"""
import pathlib
import re
import sys
import xml.etree.ElementTree as ElementTree

# What gtest itself prints around a test's own lines.
GTEST_NOISE = re.compile(r'^\[( *OK *|=+|-+| *RUN *| *PASSED *| *SKIPPED *|-*)\]|^Running main|^Note: |^\s*$')
# A terminal's colour sequences, as ctest writes them into its results.
COLOUR = re.compile(r'\[NON-XML-CHAR-0x1B\]\[[0-9;]*m')
SHOWN_LINES_OF_A_FAILURE = 60


class Counts:
    """Test cases: a gtest program or a rostest holds many."""

    def __init__(self, passed=0, failed=0, skipped=0):
        self.passed, self.failed, self.skipped = passed, failed, skipped

    def add(self, other):
        self.passed += other.passed
        self.failed += other.failed
        self.skipped += other.skipped

    def __str__(self):
        text = '%d passed, %d failed' % (self.passed, self.failed)
        return text + (', %d skipped' % self.skipped if self.skipped else '')


def cases_in(results_folder):
    """Counts of all result files of one test, and the reasons of the skipped cases."""
    counts, reasons = Counts(), []
    for path in sorted(results_folder.rglob('*.xml')):
        if path.name.startswith('rostest-'):
            continue  # repeats what the tests inside it report, unless they reported nothing
        try:
            root = ElementTree.parse(path).getroot()
        except ElementTree.ParseError:
            continue  # cut off by a crash, which ctest reports
        for case in root.iter('testcase'):
            skipped = case.find('skipped')
            if case.find('failure') is not None or case.find('error') is not None:
                counts.failed += 1
            elif skipped is not None or case.get('status') == 'notrun':
                counts.skipped += 1
                message = (skipped.get('message') or skipped.text or '').strip() if skipped is not None else ''
                reasons.append('%s: %s' % (case.get('name'), message.splitlines()[-1] if message else 'no reason'))
            else:
                counts.passed += 1
    return counts, reasons


class Test:
    def __init__(self, case, results_dir):
        self.name = case.get('name')
        self.seconds = float(case.get('time') or 0)
        self.output = COLOUR.sub('', case.findtext('system-out') or '')
        self.labels = [p.get('value') for p in case.iter('property') if p.get('name') == 'cmake_labels']
        failed = case.find('failure') is not None or case.get('status') == 'fail'
        skipped = case.find('skipped') is not None or case.get('status') in ('notrun', 'disabled')
        self.counts, self.skip_reasons = cases_in(results_dir / self.name)
        if failed and not self.counts.failed:
            self.counts.failed = 1
        elif skipped and not self.counts.skipped:
            # A test that ctest could not start is a failure; one that says it cannot run here is skipped.
            cannot_run = 'skipped: ' in self.output
            self.counts = Counts(failed=0 if cannot_run else 1, skipped=1 if cannot_run else 0)
            self.skip_reasons = [self.output.strip().splitlines()[-1]] if self.output.strip() else []
        elif not failed and not self.counts.passed and not self.counts.skipped:
            self.counts.passed = 1

    def own_lines(self):
        return [line for line in self.output.splitlines() if not GTEST_NOISE.match(line)]


def report(title, results_dir, total):
    path = results_dir / 'ctest.xml'
    if not path.is_file():
        print('\n== %s: no results in %s' % (title, results_dir))
        total.add(Counts(failed=1))
        return
    tests = [Test(case, results_dir) for case in ElementTree.parse(path).getroot().iter('testcase')]
    print('\n== %s' % title)
    for test in tests:
        print('%-6s %-44s %7.1f s  %s' % ('FAILED' if test.counts.failed else 'ok', test.name, test.seconds,
                                          test.counts))
        total.add(test.counts)
    for test in tests:
        for reason in test.skip_reasons:
            print('skipped in %s: %s' % (test.name, reason))
    for test in tests:
        if test.counts.failed:
            print('\n-- output of %s' % test.name)
            print('\n'.join(test.output.splitlines()[-SHOWN_LINES_OF_A_FAILURE:]))
        elif test.own_lines() and ('system' in test.labels or 'warning: ' in test.output):
            print('\n-- %s says' % test.name)
            print('\n'.join(test.own_lines()))


def main():
    total = Counts()
    for argument in sys.argv[1:]:
        title, folder = argument.split('=', 1)
        report(title, pathlib.Path(folder), total)
    print('\n%s' % total)
    sys.exit(0 if total.passed and not total.failed else 1)


main()
