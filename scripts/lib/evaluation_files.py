"""Reads trajectories, estimates and truths from files. What is wrong is said with the file and the line."""
import math
import pathlib

import numpy as np
import yaml

from evaluation import Extrinsics, Poses, quaternion_from_matrix

EXTRINSICS_COLUMNS = 17
# Stamps above it are no seconds: seconds since 1970 come to it in the year 5138.
LARGEST_STAMP_S = 1e11


class BadFile(ValueError):
    """What is wrong with a file, in words."""

    def __init__(self, path, line, text):
        super().__init__('%s%s: %s' % (path, '' if line is None else ':%d' % line, text))


def lines_of(path):
    """(number, text) of the lines that are neither empty nor comments."""
    try:
        text = pathlib.Path(path).read_text(encoding='utf-8-sig')  # some editors put a mark at the beginning
    except OSError as error:
        raise BadFile(path, None, error.strerror or str(error)) from error
    except UnicodeDecodeError as error:
        raise BadFile(path, None, 'is no text file') from error
    for number, line in enumerate(text.splitlines(), 1):
        if line.strip() and not line.lstrip().startswith('#'):
            yield number, line.strip()


def numbers(path, line, fields):
    try:
        values = [float(field) for field in fields]
    except ValueError as error:
        raise BadFile(path, line, 'expected numbers, found %s' % str(error).split(': ')[-1]) from error
    if not all(math.isfinite(value) for value in values):
        raise BadFile(path, line, 'a number is not finite')
    return values


def check_quaternion(path, line, q, order):
    if abs(math.sqrt(sum(value * value for value in q)) - 1.0) > 0.05:
        raise BadFile(path, line, 'the quaternion (%s) has not the length 1' % order)


def euroc_pose(path, line, text):
    fields = text.split(',')
    if len(fields) < 8:
        raise BadFile(path, line, 'expected stamp,x,y,z,qw,qx,qy,qz (EuRoC), found %d columns' % len(fields))
    if not fields[0].strip().lstrip('-').isdigit():
        raise BadFile(path, line, "the stamp '%s' is no whole number of nanoseconds, as EuRoC's are" % fields[0].strip())
    values = numbers(path, line, fields[1:8])
    check_quaternion(path, line, values[3:], 'columns 5 to 8, qw qx qy qz')
    stamp = int(fields[0])
    return stamp // 10**9 + stamp % 10**9 * 1e-9, values[:3], values[4:] + values[3:4]


def tum_pose(path, line, text):
    fields = text.split()
    if len(fields) < 8:
        raise BadFile(path, line, "expected 'stamp x y z qx qy qz qw' (TUM), found %d columns" % len(fields))
    values = numbers(path, line, fields[:8])
    if values[0] > LARGEST_STAMP_S:
        raise BadFile(path, line, 'the stamp %s is not in seconds, as TUM files have it' % fields[0])
    check_quaternion(path, line, values[4:], 'columns 5 to 8, qx qy qz qw')
    return values[0], values[1:4], values[4:]


def read_trajectory(path):
    """Poses of a file: TUM text (s, p, q xyzw) or EuRoC's csv (ns, p, q wxyz, ...). Throws BadFile."""
    poses = []
    for number, text in lines_of(path):
        if not poses and text[0].isalpha():  # the heading of a csv
            if text.startswith('stamp_s,px'):
                raise BadFile(path, number, 'is a table of extrinsics, not a trajectory: give odometry.tum or the folder')
            continue
        poses.append((euroc_pose if ',' in text else tum_pose)(path, number, text))
    return Poses(*zip(*poses)) if poses else Poses([], [], [])


def read_extrinsics(path):
    """evaluation.Extrinsics of the extrinsics.csv that calibrate_bag writes. Throws BadFile."""
    values, states = [], []
    for number, text in lines_of(path):
        fields = text.split(',')
        if len(fields) != EXTRINSICS_COLUMNS:
            raise BadFile(path, number, 'expected %d columns, found %d: not the extrinsics.csv of calibrate_bag' %
                          (EXTRINSICS_COLUMNS, len(fields)))
        if fields[0] == 'stamp_s':
            continue
        values.append(numbers(path, number, fields[:16]))
        states.append(fields[16].strip())
    return Extrinsics(values, states)


def matrix_of(path, key, value):
    try:
        T = np.array(value, float).reshape(4, 4)
    except (TypeError, ValueError) as error:
        raise BadFile(path, None, '%s is no 4x4 matrix' % key) from error
    if not np.isfinite(T).all():
        raise BadFile(path, None, '%s is not finite' % key)
    if np.abs(T[:3, :3] @ T[:3, :3].T - np.eye(3)).max() > 1e-3 or np.linalg.det(T[:3, :3]) < 0:
        raise BadFile(path, None, 'the upper left 3x3 block of %s is no rotation' % key)
    if np.abs(T[3] - [0, 0, 0, 1]).max() > 1e-9:
        raise BadFile(path, None, 'the last row of %s is not 0 0 0 1' % key)
    return T


def time_offset_of(path, camera):
    value = camera.get('timeshift_cam_imu', 0.0)
    try:
        td = float(value)
    except (TypeError, ValueError) as error:
        raise BadFile(path, None, 'timeshift_cam_imu is no number') from error
    if not np.isfinite(td):
        raise BadFile(path, None, 'timeshift_cam_imu is not finite')
    return td


def read_extrinsics_truth(path):
    """(p, q, td) of T_imu_cam from EuRoC's cam0/sensor.yaml, a Kalibr camchain, or the simulator's truth. Throws BadFile."""
    try:
        text = pathlib.Path(path).read_text(encoding='utf-8-sig')
        data = yaml.safe_load('#' + text if text.startswith('%YAML:') else text)
    except OSError as error:
        raise BadFile(path, None, error.strerror or str(error)) from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        mark = getattr(error, 'problem_mark', None)
        raise BadFile(path, mark and mark.line + 1, 'is no YAML') from error
    if not isinstance(data, dict):
        raise BadFile(path, None, 'is no YAML map of keys and values')
    camera = data.get('cam0', data)
    if not isinstance(camera, dict):
        raise BadFile(path, None, 'cam0 is no map of keys and values')
    if 'T_BS' in data:
        T_BS = data['T_BS']
        T = matrix_of(path, 'T_BS', T_BS.get('data') if isinstance(T_BS, dict) else T_BS)
    elif 'T_imu_cam' in camera:
        T = matrix_of(path, 'T_imu_cam', camera['T_imu_cam'])
    elif 'T_cam_imu' in camera:
        T = np.linalg.inv(matrix_of(path, 'T_cam_imu', camera['T_cam_imu']))
    else:
        raise BadFile(path, None, 'has neither T_BS (EuRoC) nor T_cam_imu (Kalibr) nor T_imu_cam')
    return T[:3, 3], quaternion_from_matrix(T[:3, :3]), time_offset_of(path, camera)
