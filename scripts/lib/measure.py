#!/usr/bin/python3
"""The table of figures of scripts/measure."""
import argparse
import os
import pathlib
import shutil
import subprocess
import sys

import numpy as np
import yaml

import clip_variants
import evaluation
import evaluation_files

ROOT = pathlib.Path(__file__).resolve().parents[2]
CLIP = 'euroc/MH_05_difficult/mav0'
STANDSTILL = 'euroc/V1_01_easy/mav0'
SIMULATED_SECONDS = 60


class Table:
    """Rows of case, figure, value and bar; a row without a bar only informs."""

    def __init__(self):
        self.failed = 0
        self.rows = []

    def below(self, case, figure, value, bar, unit):
        passed = value is not None and np.isfinite(value) and value < bar
        self.add(case, figure, '-' if value is None else '%.3f %s' % (value, unit), '< %g %s' % (bar, unit), passed)

    def above(self, case, figure, value, bar, unit):
        passed = value is not None and np.isfinite(value) and value > bar
        self.add(case, figure, '-' if value is None else '%.3f %s' % (value, unit), '> %g %s' % (bar, unit), passed)

    def holds(self, case, figure, value, bar, passed):
        self.add(case, figure, value, bar, passed)

    def inform(self, case, figure, value):
        self.add(case, figure, value, '', None)

    def add(self, case, figure, value, bar, passed):
        verdict = '' if passed is None else 'pass' if passed else 'FAIL'
        self.failed += verdict == 'FAIL'
        self.rows.append((case, figure, str(value), bar, verdict))
        print('%-11s %-42s %16s  %-12s %s' % self.rows[-1], flush=True)


class Run:
    """One run of a program into a folder of its own."""

    def __init__(self, out, command):
        self.out = out
        shutil.rmtree(out, ignore_errors=True)
        out.parent.mkdir(parents=True, exist_ok=True)
        with open(str(out) + '.log', 'w') as log:
            self.code = subprocess.run([str(word) for word in command], stdout=log, stderr=subprocess.STDOUT).returncode

    def yaml(self, name):
        path = self.out / name
        return yaml.safe_load(path.read_text()) if path.is_file() else {}

    def score(self, truth, extrinsics_truth):
        """Figures of evaluation.py; empty where the run wrote nothing."""
        try:
            extrinsics = evaluation_files.read_extrinsics(self.out / 'extrinsics.csv')
            odometry = evaluation_files.read_trajectory(self.out / 'odometry.tum')
        except evaluation_files.BadFile:
            return {}
        if not len(extrinsics):
            return {}
        figures = evaluation.score_extrinsics(extrinsics, evaluation_files.read_extrinsics_truth(extrinsics_truth))
        figures.update(evaluation.score_odometry(odometry, evaluation_files.read_trajectory(truth), extrinsics.stamps[0],
                                                 extrinsics.stamps[-1]))
        return figures


def simulated(out, seed, mode):
    run = Run(out, ['calibrate_simulation', '--seed', seed, '--mode', mode, '--duration', SIMULATED_SECONDS,
                    '--out', out])
    return run, run.score(out / 'truth.tum', out / 'truth.yaml')


def exact(table, arguments):
    _, figures = simulated(arguments.out / 'exact', 1, 'exact')
    table.below('exact', 'rotation at the end', figures.get('rotation_deg'), 0.01, 'deg')
    translation = figures.get('translation_m')
    table.below('exact', 'translation at the end', None if translation is None else 1e3 * translation, 0.5, 'mm')
    table.inform('exact', 'ATE', '%.2e m' % figures['ate_m'] if 'ate_m' in figures else '-')


def rendered_run(out, seed):
    """Images of the simulated rig through a bag, as a recording would be."""
    out.mkdir(parents=True, exist_ok=True)
    bag, truth, extrinsics = out / 'input.bag', out / 'truth.csv', out / 'truth.yaml'
    simulation = Run(out / 'simulation', ['simulate_bag', '--seed', seed, '--duration', SIMULATED_SECONDS, '--truth-csv',
                                          truth, '--truth-extrinsics', extrinsics, '--force', '--quiet', bag])
    if simulation.code != 0:
        return {}
    run = Run(out / 'result', ['calibrate_bag', '--config', ROOT / 'config/simulated_rig.yaml', '--force', '--out',
                               out / 'result', bag])
    bag.unlink()
    return run.score(truth, extrinsics)


def several_seeds(table, case, arguments, run_seed, medians=(0.2, 1.0, 0.5), worsts=(0.3, 1.5, 1.0)):
    """`medians`, `worsts`: bars of rotation [deg], translation [cm] and ATE [% of the distance]."""
    runs = [run_seed(arguments.out / ('%s_%d' % (case, seed)), seed) for seed in range(1, arguments.seeds + 1)]
    converged = sum(figures.get('final_state') in ('converged', 'frozen') for figures in runs)
    table.holds(case, 'seeds converged', '%d of %d' % (converged, len(runs)), 'all', converged == len(runs))

    def over_runs(reduce, name, factor=1.0):
        values = [figures.get(name) for figures in runs]
        return None if any(value is None for value in values) else factor * reduce(values)

    after = ' after %d s, ' % SIMULATED_SECONDS
    for reduce, statistic, (rotation_deg, translation_cm, ate_percent) in ((np.median, 'median', medians),
                                                                           (max, 'worst', worsts)):
        table.below(case, 'rotation' + after + statistic, over_runs(reduce, 'rotation_deg'), rotation_deg, 'deg')
        table.below(case, 'translation' + after + statistic, over_runs(reduce, 'translation_m', 100.0), translation_cm, 'cm')
        table.below(case, 'ATE / distance, ' + statistic, over_runs(reduce, 'ate_percent'), ate_percent, '%')
    for name, text in (('says_converged_s', 'says converged after, worst'), ('first_pose_s', 'first odometry, worst'),
                       ('rotation_sigmas', 'rotation error / sigma, worst'),
                       ('translation_sigmas', 'translation error / sigma, worst')):
        value = over_runs(max, name)
        table.inform(case, text, '-' if value is None else '%.2f' % value)
    return runs


def at_converged(table, case, runs, rotation_deg, translation_cm):
    """Figures at the moment when `converged` is declared; the worst twentieth of the runs does not count."""
    def quantile95(name, factor=1.0):
        values = sorted(factor * figures.get(name, np.inf) for figures in runs)
        return values[int(np.ceil(0.95 * len(values))) - 1]

    table.below(case, 'rotation at converged, 95 %', quantile95('rotation_when_converged_deg'), rotation_deg, 'deg')
    table.below(case, 'translation at converged, 95 %', quantile95('translation_when_converged_m', 100.0), translation_cm,
                'cm')
    within = np.mean([figures.get('within_3_sigma_when_converged', 0.0) == 1.0 for figures in runs])
    table.holds(case, 'runs with all axes within 3 sigma at converged', '%.1f %%' % (100 * within), '>= 95 %', within >= 0.95)


def noisy(table, arguments):
    several_seeds(table, 'noisy', arguments, lambda out, seed: simulated(out, seed, 'noisy')[1])


def realistic(table, arguments):
    several_seeds(table, 'realistic', arguments, lambda out, seed: simulated(out, seed, 'realistic')[1])


def rendered(table, arguments):
    at_converged(table, 'rendered', several_seeds(table, 'rendered', arguments, rendered_run, (0.1, 0.5, 0.3), (0.2, 1.0, 1.0)),
                 0.3, 1.5)


TAKE_OFF = 2.0  # [s] of the clip, nearly still until then


def clip_paths(folder):
    data = pathlib.Path(os.environ['AUTOCAL_VIO_DATA']) / folder
    return data, data / 'state_groundtruth_estimate0/data.csv', data / 'cam0/sensor.yaml'


def clip(table, arguments):
    data, truth, sensor = clip_paths(CLIP)
    out = arguments.out / 'clip'
    run = Run(out, ['calibrate_bag', '--config', ROOT / 'config/euroc.yaml', '--force', '--out', out, data])
    figures, report = run.score(truth, sensor), run.yaml('report.yaml')
    table.holds('clip', 'calibrate_bag ends by itself', 'exit %d' % run.code, '0 or 2', run.code in (0, 2))
    first = figures.get('first_pose_s')
    table.below('clip', 'first odometry after take-off', None if first is None else first - TAKE_OFF, 6, 's')
    table.below('clip', 'rotation at the end', figures.get('rotation_deg'), 0.4, 'deg')
    translation = figures.get('translation_m')
    table.below('clip', 'translation at the end', None if translation is None else 100 * translation, 4, 'cm')
    table.below('clip', 'rotation error / sigma, worst axis', figures.get('rotation_sigmas'), 3, '')
    table.below('clip', 'translation error / sigma, worst axis', figures.get('translation_sigmas'), 3, '')
    table.below('clip', 'ATE', figures.get('ate_m'), 0.12, 'm')
    table.below('clip', 'largest gap in the odometry', figures.get('largest_gap_s'), 0.1, 's')
    table.inform('clip', 'verdict', report.get('verdict'))
    for name, text in (('scale', 'scale'), ('coverage', 'coverage'), ('says_converged_s', 'says converged after [s]')):
        value = figures.get(name)
        table.inform('clip', text, '-' if value is None else '%.3f' % value)
    speed = report.get('ms_per_image') or {}
    table.below('speed', 'CPU per image, median', speed.get('median'), 30, 'ms')
    for name in ('p95', 'p99', 'max'):
        table.inform('speed', 'CPU per image, ' + name, '%s ms' % speed.get(name))


def initial(table, arguments):
    data, truth, sensor = clip_paths(CLIP)
    out = arguments.out / 'initial'
    T_imu_cam = np.array(yaml.safe_load(sensor.read_text())['T_BS']['data'], float).reshape(4, 4)
    prior = arguments.out / 'initial_camchain.yaml'
    prior.write_text(yaml.safe_dump({'cam0': {'T_cam_imu': np.linalg.inv(T_imu_cam).tolist()}}))
    run = Run(out, ['calibrate_bag', '--config', ROOT / 'config/euroc.yaml', '--initial', prior, '--force', '--out', out,
                    data])
    figures = run.score(truth, sensor)
    table.above('initial', 'coverage', figures.get('coverage'), 0.93, '')
    table.below('initial', 'ATE', figures.get('ate_m'), 0.1, 'm')
    table.below('initial', 'rotation at the end', figures.get('rotation_deg'), 0.35, 'deg')
    translation = figures.get('translation_m')
    table.below('initial', 'translation at the end', None if translation is None else 100 * translation, 2.5, 'cm')
    table.below('initial', 'rotation error / sigma, worst axis', figures.get('rotation_sigmas'), 3, '')
    table.below('initial', 'translation error / sigma, worst axis', figures.get('translation_sigmas'), 3, '')
    table.inform('initial', 'scale', '-' if figures.get('scale') is None else '%.3f' % figures['scale'])


def rig_of(recording):
    """The rig file of a variant: config/euroc.yaml with what the variant has changed."""
    rig = yaml.safe_load((ROOT / 'config/euroc.yaml').read_text())
    rig['cam0'].update(intrinsics=recording.camera['intrinsics'], resolution=recording.camera['resolution'],
                       distortion_coeffs=recording.camera['distortion_coefficients'])
    rig['imu0']['update_rate'] = recording.sensor['rate_hz']
    return rig


def variants(table, arguments):
    """The clip made into others, from nothing, against the clip's own bars."""
    data, _, _ = clip_paths(CLIP)
    for change in clip_variants.VARIANTS:
        name = change.__name__
        folder, out = arguments.out / 'variants' / name / 'mav0', arguments.out / 'variants' / name / 'result'
        recording = clip_variants.Recording(data)
        change(recording)
        recording.write(folder)
        rig = folder / 'rig.yaml'
        rig.write_text(yaml.safe_dump(rig_of(recording)))
        run = Run(out, ['calibrate_bag', '--config', rig, '--force', '--out', out, folder])
        figures = run.score(folder / 'state_groundtruth_estimate0/data.csv', folder / 'cam0/sensor.yaml')
        shutil.rmtree(folder / 'cam0/data')
        table.below(name, 'first odometry after', figures.get('first_pose_s'), 10, 's')
        table.below(name, 'ATE', figures.get('ate_m'), 0.12, 'm')
        table.below(name, 'rotation at the end', figures.get('rotation_deg'), 0.4, 'deg')
        table.below(name, 'translation at the end', 100 * figures.get('translation_m', np.nan), 4, 'cm')
        sigmas = [figures.get(part + '_sigmas', np.nan) for part in ('rotation', 'translation')]
        table.below(name, 'error / sigma, worst axis', max(sigmas), 3, '')
        table.inform(name, 'scale', '%.3f' % figures.get('scale', np.nan))


def live(table, arguments):
    data, truth, sensor = clip_paths(CLIP)
    out = arguments.out / 'live'
    images = sum(1 for line in (data / 'cam0/data.csv').read_text().splitlines() if line and not line.startswith('#'))
    run = Run(out, [ROOT / 'scripts/demo', data, '--out', out])
    figures, counts, report = run.score(truth, sensor), run.yaml('live.yaml'), run.yaml('report.yaml')
    processed = report.get('images_processed', 0)
    table.holds('live', 'images processed', '%d of %d' % (processed, images), 'all', processed >= images - 1)
    table.holds('live', 'images dropped', report.get('images_dropped'), '0', report.get('images_dropped') == 0)
    status = counts.get('status_messages', 0)
    table.holds('live', 'status messages', status, 'one an image', status >= images - 2)
    poses = figures.get('poses', 0)
    table.below('live', 'largest gap in the odometry', figures.get('largest_gap_s'), 0.1, 's')
    transforms = counts.get('transforms_by_parent', {})
    table.holds('live', 'tf of the odometry', transforms.get('odom', 0), 'one a pose', transforms.get('odom', 0) >= poses > 0)
    table.below('live', 'first odometry after', figures.get('first_pose_s'), 12, 's')
    table.below('live', 'rotation at the end', figures.get('rotation_deg'), 0.4, 'deg')
    table.below('live', 'ATE', figures.get('ate_m'), 0.12, 'm')
    for key, text in (('latency_ms', 'image received to status'), ('odometry_delay_ms', 'image stamp to odometry')):
        for name in ('median', 'p95', 'max'):
            table.inform('live', '%s, %s' % (text, name), '%s ms' % (counts.get(key) or {}).get(name))


def standstill(table, arguments):
    data, _, _ = clip_paths(STANDSTILL)
    out = arguments.out / 'standstill'
    run = Run(out, ['calibrate_bag', '--config', ROOT / 'config/euroc.yaml', '--force', '--out', out, data])
    table.holds('standstill', 'not converged', 'exit %d' % run.code, 'exit 2', run.code == 2)
    try:
        extrinsics = evaluation_files.read_extrinsics(out / 'extrinsics.csv')
        odometry = evaluation_files.read_trajectory(out / 'odometry.tum')
    except evaluation_files.BadFile:
        table.holds('standstill', 'results', 'none', 'written', False)
        return
    declared = sorted(set(extrinsics.states) - {'waiting_for_data', 'calibrating_rotation'})
    table.holds('standstill', 'states beyond seeking the rotation', ', '.join(declared) or 'none', 'none', not declared)
    drift = float(np.linalg.norm(np.ptp(odometry.positions, axis=0))) if len(odometry) else 0.0
    table.below('standstill', 'odometry drift', drift, 0.01, 'm')
    report = run.yaml('report.yaml')
    words = ' '.join(str(report.get(key, '')) for key in ('reason', 'motion_advice'))
    table.holds('standstill', 'says that motion is missing', 'motion' in words or 'rotat' in words, 'True',
                'motion' in words or 'rotat' in words)
    table.inform('standstill', 'reason', report.get('reason'))


def run_test_program(table, case, arguments, program, settings):
    """A test that holds its bars itself; what it prints with bars between has the figures."""
    arguments.out.mkdir(parents=True, exist_ok=True)
    log = arguments.out / (program + '.log')
    environment = dict(os.environ, **{name: str(value) for name, value in settings.items()})
    with open(log, 'w') as stream:
        code = subprocess.run([ROOT / 'build/devel/lib/autocal_vio' / program], env=environment, stdout=stream,
                              stderr=subprocess.STDOUT).returncode
    for line in log.read_text().splitlines():
        if ' | ' in line:
            print(line)
    text = ', '.join('%s=%s' % (name[len('AUTOCAL_VIO_'):].lower(), value) for name, value in settings.items()
                     if not isinstance(value, os.PathLike))
    table.holds(case, '%s, %s' % (program, text), 'exit %d' % code, 'exit 0', code == 0)


def initializer(table, arguments):
    """The calibrating initialiser over many seeds; its tests hold the bars, their output has the figures. Then on images."""
    seeds = arguments.seeds_of_initializer
    subprocess.run([ROOT / 'scripts/build', 'test_initializer_monte_carlo', 'test_gyroscope_bias_sweep'], check=True,
                   stdout=subprocess.DEVNULL)
    for program in ('test_initializer_monte_carlo', 'test_gyroscope_bias_sweep'):
        run_test_program(table, 'initializer', arguments, program,
                         {'AUTOCAL_VIO_SEEDS': seeds, 'AUTOCAL_VIO_SWEEP_PNG': arguments.out / 'gyroscope_bias.png'})
    arguments.seeds = 20
    rendered(table, arguments)
    for case in (clip, standstill):
        if os.environ.get('AUTOCAL_VIO_DATA'):
            case(table, arguments)
        else:
            table.inform(case.__name__, 'left out', 'no AUTOCAL_VIO_DATA')


def consistency(table, arguments):
    """NEES of all that is published and the calibration against its Cramer-Rao bound; memory over half an hour."""
    seeds = arguments.seeds_of_consistency
    programs = {'test_estimator_consistency': {'AUTOCAL_VIO_SEEDS': seeds, 'AUTOCAL_VIO_SECONDS': 60},
                'test_memory': {'AUTOCAL_VIO_MINUTES': 30}}
    subprocess.run([ROOT / 'scripts/build', *programs], check=True, stdout=subprocess.DEVNULL)
    for program, settings in programs.items():
        run_test_program(table, 'consistency', arguments, program, settings)


CASES = {'exact': exact, 'noisy': noisy, 'realistic': realistic, 'rendered': rendered, 'clip': clip,
         'initial': initial, 'live': live, 'standstill': standstill, 'initializer': initializer,
         'consistency': consistency, 'variants': variants}
LONG = {'initializer', 'consistency', 'variants'}  # only when asked for
NEED_DATA = {'clip', 'initial', 'live', 'standstill', 'variants'}


def main():
    parser = argparse.ArgumentParser(prog='scripts/measure')
    parser.add_argument('--only', help='cases, separated by commas: ' + ', '.join(CASES))
    parser.add_argument('--seeds', type=int, default=10, help='runs of each simulated case with noise')
    parser.add_argument('--seeds-of-initializer', type=int, default=100, metavar='N', help='runs of the case initializer')
    parser.add_argument('--seeds-of-consistency', type=int, default=50, metavar='N', help='runs of the case consistency')
    parser.add_argument('--out', type=pathlib.Path, default=ROOT / 'build' / 'measure')
    arguments = parser.parse_args()
    names = arguments.only.split(',') if arguments.only else [name for name in CASES if name not in LONG]
    unknown = [name for name in names if name not in CASES]
    if unknown:
        parser.error('no such case: ' + ', '.join(unknown))
    arguments.out = arguments.out.resolve()
    arguments.out.mkdir(parents=True, exist_ok=True)
    table = Table()
    for name in names:
        if name in NEED_DATA and not os.environ.get('AUTOCAL_VIO_DATA'):
            table.inform(name, 'left out', 'no AUTOCAL_VIO_DATA')
        else:
            CASES[name](table, arguments)
    print('\n%d of %d figures pass' % (sum(row[4] == 'pass' for row in table.rows),
                                       sum(row[4] != '' for row in table.rows)))
    sys.exit(1 if table.failed else 0)


main()
