#!/usr/bin/python3
"""Draws data_flow.png beside this file: what goes where in the nodelet."""
import pathlib

import matplotlib

matplotlib.use('Agg')
import matplotlib.pyplot as plt  # noqa: E402
from matplotlib.patches import FancyBboxPatch  # noqa: E402
from PIL import Image  # noqa: E402

INPUT, THREAD, CORE, OUTPUT = '#f3e3c3', '#dfe7ee', '#c9def2', '#d5ead2'
INK = '#2b3a48'


def box(axes, x, y, width, height, title, text='', colour=THREAD, head=False):
    """A box by its lower left corner; `head`: the title stands at the top, for boxes that hold others."""
    axes.add_patch(FancyBboxPatch((x, y), width, height, boxstyle='round,pad=0,rounding_size=0.12',
                                  facecolor=colour, edgecolor=INK, linewidth=0.9))
    lines = text.count('\n') + 1 if text else 0
    top = y + height - 0.23 if head else y + height / 2 + 0.11 * lines
    axes.text(x + width / 2, top, title, ha='center', va='center', weight='bold', size=8.5, color=INK)
    if text:
        axes.text(x + width / 2, top - 0.16, text, ha='center', va='top', size=7.2, color=INK, linespacing=1.25)


def arrow(axes, points, label='', at=None, align='center'):
    """A line through the points, with a head at the last."""
    for begin, end in zip(points[:-2], points[1:-1]):
        axes.plot([begin[0], end[0]], [begin[1], end[1]], color=INK, linewidth=1.1, solid_capstyle='round')
    axes.annotate('', xy=points[-1], xytext=points[-2],
                  arrowprops={'arrowstyle': '-|>', 'color': INK, 'linewidth': 1.1, 'shrinkA': 0, 'shrinkB': 0})
    if label:
        axes.text(*at, label, ha=align, va='center', size=7, color=INK, style='italic')


def draw_inputs(axes):
    box(axes, 0.1, 5.55, 2.1, 1.15, 'drivers', 'image, imu\ncamera_info, where the\nrig file has no intrinsics', INPUT)
    box(axes, 0.1, 3.9, 2.1, 1.05, 'files', 'rig file, estimator file\nrobot_description (URDF)', INPUT)
    box(axes, 0.1, 0.55, 2.1, 1.25, 'rviz panel', 'plots of the status\nbuttons: freeze, release,\nreset, save', INPUT)


def draw_nodelet(axes):
    box(axes, 2.75, 0.3, 7.75, 6.7, '', '', '#f6f8fa')
    axes.text(9.5, 0.52, 'nodelet', ha='center', va='center', weight='bold', size=8.5, color=INK)
    box(axes, 3.0, 5.55, 1.75, 1.05, 'SensorInputs', 'checks, stamps,\nsilence')
    box(axes, 3.0, 3.9, 1.75, 1.05, 'PacketQueue', 'bounded; image, IMU,\ncommand, in order')
    box(axes, 3.0, 0.55, 1.75, 1.25, 'services', 'reset, freeze,\nsave: each a command\nfor the worker')
    box(axes, 8.75, 5.55, 1.5, 1.05, 'Propagator', 'the pose, at each\nIMU sample')
    box(axes, 8.75, 3.9, 1.5, 1.05, 'VioOutputs', 'messages from\na VioUpdate')
    box(axes, 8.75, 2.25, 1.5, 1.05, 'VioDiagnostics', 'in words')


def draw_core(axes):
    box(axes, 5.15, 1.4, 3.2, 5.2, 'Worker thread: VioSystem', '', CORE, head=True)
    box(axes, 5.35, 5.5, 2.8, 0.66, 'MeasurementSync', 'an image, once the IMU covers it')
    box(axes, 5.35, 4.6, 2.8, 0.66, 'FeatureTracker', 'corners and their patches')
    box(axes, 5.35, 3.55, 1.3, 0.8, 'initialiser', 'rotation, scale,\ngravity, lever arm')
    box(axes, 6.85, 3.55, 1.3, 0.8, 'estimator', 'sliding window')
    box(axes, 6.85, 2.55, 1.3, 0.75, 'monitor', 'converged?\nwhat is missing?')
    box(axes, 5.35, 1.6, 2.8, 0.7, 'VioUpdate', 'state, reason, advice, pose, calibration')


def draw_outputs(axes):
    box(axes, 11.05, 5.75, 2.35, 0.65, 'topics', '~odometry_imu', OUTPUT)
    box(axes, 11.05, 3.75, 2.35, 1.7, 'topics', '~odometry, ~extrinsics\n~calibration_status\n~path, ~landmarks, ~tracks', OUTPUT)
    box(axes, 11.05, 2.95, 2.35, 0.65, 'tf', 'odom > IMU or base, IMU > camera', OUTPUT)
    box(axes, 11.05, 2.1, 2.35, 0.65, '/diagnostics', '', OUTPUT)
    box(axes, 11.05, 0.55, 2.35, 1.0, 'files', 'camchain-imucam.yaml\nURDF, its camera joint', OUTPUT)


def draw_arrows(axes):
    arrow(axes, [(2.2, 6.1), (3.0, 6.1)])
    arrow(axes, [(2.2, 4.2), (2.6, 4.2), (2.6, 3.3), (5.15, 3.3)], 'at start', (4.5, 3.42))
    arrow(axes, [(3.87, 5.55), (3.87, 4.95)])
    arrow(axes, [(4.75, 4.4), (5.15, 4.4)])
    arrow(axes, [(4.4, 6.6), (4.4, 6.78), (9.5, 6.78), (9.5, 6.6)], 'IMU', (9.0, 6.88))
    arrow(axes, [(6.75, 5.5), (6.75, 5.26)])
    arrow(axes, [(6.0, 4.6), (6.0, 4.35)])
    arrow(axes, [(7.5, 4.6), (7.5, 4.35)])
    arrow(axes, [(6.65, 3.95), (6.85, 3.95)])
    arrow(axes, [(6.0, 3.55), (6.0, 2.3)])
    arrow(axes, [(7.5, 3.55), (7.5, 3.3)])
    arrow(axes, [(7.5, 2.55), (7.5, 2.3)])
    arrow(axes, [(8.15, 1.95), (8.55, 1.95), (8.55, 4.4), (8.75, 4.4)])
    arrow(axes, [(9.5, 4.95), (9.5, 5.55)])
    arrow(axes, [(9.5, 3.9), (9.5, 3.3)])
    arrow(axes, [(10.25, 6.08), (11.05, 6.08)])
    arrow(axes, [(10.25, 4.6), (11.05, 4.6)])
    arrow(axes, [(10.25, 4.1), (10.75, 4.1), (10.75, 3.27), (11.05, 3.27)])
    arrow(axes, [(10.25, 2.6), (10.65, 2.6), (10.65, 2.42), (11.05, 2.42)])
    arrow(axes, [(2.2, 1.17), (3.0, 1.17)])
    arrow(axes, [(3.87, 1.8), (3.87, 3.9)], 'command', (3.82, 2.6), 'right')
    arrow(axes, [(4.75, 1.05), (11.05, 1.05)], 'save: the calibration as it is', (7.0, 1.18))
    arrow(axes, [(13.4, 4.6), (13.65, 4.6), (13.65, 0.12), (1.15, 0.12), (1.15, 0.55)], '~calibration_status',
          (8.0, 0.0))


def main():
    figure, axes = plt.subplots(figsize=(11.2, 6.0))
    axes.set_xlim(0, 13.8)
    axes.set_ylim(-0.15, 7.1)
    axes.axis('off')
    draw_inputs(axes)
    draw_nodelet(axes)
    draw_core(axes)
    draw_outputs(axes)
    draw_arrows(axes)
    figure.subplots_adjust(0, 0, 1, 1)
    path = pathlib.Path(__file__).with_suffix('.png')
    figure.savefig(path, dpi=100)
    Image.open(path).convert('RGB').quantize(64).save(path, optimize=True)  # a quarter of the size



if __name__ == '__main__':
    main()
