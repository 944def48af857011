"""Draws what evaluation.py compares, as PNG."""
import pathlib

import matplotlib

matplotlib.use('Agg')
import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402

COLOURS = ('#c0392b', '#1e8449', '#2471a3')


def save(figure, path):
    figure.savefig(path, dpi=100)
    plt.close(figure)
    return path


def trajectory(comparison, truth, path):
    figure, (top, side) = plt.subplots(2, 1, figsize=(8, 9), height_ratios=(3, 1), constrained_layout=True)
    begin, end = comparison.estimate.stamps[[0, -1]]
    truth = truth.only((truth.stamps >= begin) & (truth.stamps <= end))
    top.plot(truth.positions[:, 0], truth.positions[:, 1], color='0.6', label='truth')
    top.plot(comparison.estimate.positions[:, 0], comparison.estimate.positions[:, 1], color=COLOURS[2], label='estimate')
    top.plot(*comparison.estimate.positions[0, :2], 'o', color=COLOURS[2], label='first pose')
    top.set(xlabel='x [m]', ylabel='y [m]', title='From above, after alignment of yaw and position')
    top.axis('equal')
    top.legend()
    side.plot(truth.stamps - begin, truth.positions[:, 2], color='0.6')
    side.plot(comparison.estimate.stamps - begin, comparison.estimate.positions[:, 2], color=COLOURS[2])
    side.set(xlabel='time since the first pose [s]', ylabel='height [m]')
    for axes in (top, side):
        axes.grid(alpha=0.3)
    return save(figure, path)


def errors(comparison, relative, path):
    figure, rows = plt.subplots(3, 1, figsize=(8, 9), constrained_layout=True)
    time = comparison.estimate.stamps - comparison.estimate.stamps[0]
    for axis in range(3):
        rows[0].plot(time, comparison.position_error[:, axis], color=COLOURS[axis], label='xyz'[axis])
        rows[1].plot(time, np.degrees(comparison.attitude_error[:, axis]), color=COLOURS[axis], label='xyz'[axis])
    rows[0].set(ylabel='position error [m]', title='Estimate less truth (positions in the world, angles in the body)')
    rows[1].set(xlabel='time since the first pose [s]', ylabel='attitude error [deg]')
    rows[0].legend(ncol=3)
    bars = np.arange(len(relative))
    rows[2].bar(bars - 0.2, [100 * row['translation_m'] for row in relative], 0.4, color=COLOURS[2], label='translation [cm]')
    rows[2].bar(bars + 0.2, [10 * row['rotation_deg'] for row in relative], 0.4, color=COLOURS[0], label='rotation [0.1 deg]')
    rows[2].set(xticks=bars, ylabel='relative error (rms)')
    rows[2].set_xticklabels([row['over'] for row in relative])
    rows[2].legend()
    for axes in rows:
        axes.grid(alpha=0.3)
    return save(figure, path)


def calibration(extrinsics, truth, path):
    """Errors of T_imu_cam and of the time offset with bands of 3 sigma; those before a sigma is known are left out."""
    position, rotation = extrinsics.errors(truth[0], truth[1])
    figure, rows = plt.subplots(3, 1, figsize=(8, 9), sharex=True, constrained_layout=True)
    time = extrinsics.stamps - extrinsics.stamps[0]
    panels = ((rows[0], np.degrees(rotation), np.degrees(extrinsics.sigma_rotations), 'rotation error [deg], camera axes', 2),
              (rows[1], 100 * position, 100 * extrinsics.sigma_positions, 'translation error [cm], IMU axes', 10),
              (rows[2], 1e3 * (extrinsics.td - truth[2])[:, None], 1e3 * extrinsics.sigma_td[:, None],
               'time offset error [ms]', 5))
    for axes, error, sigma, label, span in panels:
        unknown = np.any(sigma > 100 * span, axis=1)
        for axis in range(error.shape[1]):
            curve = np.where(unknown, np.nan, error[:, axis])
            axes.plot(time, curve, color=COLOURS[axis], label='xyz'[axis])
            axes.fill_between(time, curve - 3 * sigma[:, axis], curve + 3 * sigma[:, axis], color=COLOURS[axis], alpha=0.15)
        axes.axhline(0.0, color='0.4', linewidth=0.8)
        last = np.abs(error[-1])
        span = max(span, 1.2 * np.max(last[np.isfinite(last)], initial=0.0))  # what it ends with is in the picture
        axes.set(ylabel=label, ylim=(-span, span))
        axes.grid(alpha=0.3)
    rows[0].legend(ncol=3)
    rows[2].set(xlabel='time since the first image [s]')
    return save(figure, path)


def draw(folder, comparison, truth, relative, extrinsics, extrinsics_truth):
    """Writes what there is to draw into the folder; the paths written."""
    folder = pathlib.Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    if comparison is not None and comparison.possible:
        paths.append(trajectory(comparison, truth, folder / 'trajectory.png'))
        paths.append(errors(comparison, relative, folder / 'errors.png'))
    if extrinsics_truth is not None and extrinsics is not None and len(extrinsics):
        paths.append(calibration(extrinsics, extrinsics_truth, folder / 'calibration_error.png'))
    return paths
