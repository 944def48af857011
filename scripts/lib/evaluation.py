"""Scores what the estimator wrote (odometry.tum, extrinsics.csv) against the truth.

Frames as in docs/notation.md: T_AB takes coordinates in B to A; quaternions are x y z w rows of an array.
Position errors are taken after an alignment with four degrees of freedom (yaw and position): roll, pitch and scale are
observable with an IMU and get no help.
"""
import csv
import math
import pathlib

import numpy as np
import yaml

# Truth further apart than this is not interpolated [s].
LARGEST_TRUTH_GAP_S = 0.2


def normalized(q):
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def multiply(a, b):
    """Hamilton product of quaternions (N x 4, x y z w)."""
    av, aw, bv, bw = a[..., :3], a[..., 3:], b[..., :3], b[..., 3:]
    vector = aw * bv + bw * av + np.cross(av, bv)
    return np.concatenate([vector, aw * bw - np.sum(av * bv, axis=-1, keepdims=True)], axis=-1)


def inverse(q):
    return q * np.array([-1.0, -1.0, -1.0, 1.0])


def log(q):
    """Rotation vectors [rad] of unit quaternions, each of length at most pi."""
    q = np.where(q[..., 3:] < 0, -q, q)
    norm = np.linalg.norm(q[..., :3], axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(norm, q[..., 3:])
    return q[..., :3] * np.where(norm > 1e-9, angle / np.maximum(norm, 1e-300), 2.0)


def quaternion_from_matrix(R):
    """x y z w of a rotation matrix: the eigenvector of Bar-Itzhack's symmetric matrix to its largest eigenvalue."""
    K = np.array([
        [R[0, 0] - R[1, 1] - R[2, 2], R[0, 1] + R[1, 0], R[0, 2] + R[2, 0], R[2, 1] - R[1, 2]],
        [R[0, 1] + R[1, 0], R[1, 1] - R[0, 0] - R[2, 2], R[1, 2] + R[2, 1], R[0, 2] - R[2, 0]],
        [R[0, 2] + R[2, 0], R[1, 2] + R[2, 1], R[2, 2] - R[0, 0] - R[1, 1], R[1, 0] - R[0, 1]],
        [R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], R[0, 0] + R[1, 1] + R[2, 2]]])
    return normalized(np.linalg.eigh(K)[1][:, -1])


class Poses:
    """A trajectory: stamps [s] (N), positions [m] (N x 3), quaternions (N x 4)."""

    def __init__(self, stamps, positions, quaternions):
        order = np.argsort(stamps, kind='stable')
        self.stamps = np.asarray(stamps, float)[order]
        self.positions = np.asarray(positions, float).reshape(-1, 3)[order]
        self.quaternions = np.asarray(quaternions, float).reshape(-1, 4)[order]
        if len(self.stamps):
            self.quaternions = normalized(self.quaternions)

    def __len__(self):
        return len(self.stamps)

    def at(self, stamps):
        """Interpolated poses and a mask of the stamps that the trajectory covers."""
        left = np.clip(np.searchsorted(self.stamps, stamps, side='right') - 1, 0, len(self) - 2)
        step = self.stamps[left + 1] - self.stamps[left]
        covered = (stamps >= self.stamps[0]) & (stamps <= self.stamps[-1]) & (step <= LARGEST_TRUTH_GAP_S)
        u = ((stamps - self.stamps[left]) / np.maximum(step, 1e-12))[:, None]
        positions = (1 - u) * self.positions[left] + u * self.positions[left + 1]
        a, b = self.quaternions[left], self.quaternions[left + 1]
        b = np.where(np.sum(a * b, axis=1, keepdims=True) < 0, -b, b)
        return Poses(stamps, positions, (1 - u) * a + u * b), covered

    def only(self, mask):
        return Poses(self.stamps[mask], self.positions[mask], self.quaternions[mask])


def read_trajectory(path):
    """TUM text (s, p, q xyzw) or EuRoC's csv (ns, p, q wxyz, ...)."""
    stamps, positions, quaternions = [], [], []
    for line in pathlib.Path(path).read_text().splitlines():
        if not line.strip() or line.lstrip().startswith('#') or line[0].isalpha():
            continue
        if ',' in line:
            fields = line.split(',')
            stamps.append(int(fields[0]) * 1e-9)
            values = [float(field) for field in fields[1:8]]
            quaternions.append(values[4:7] + values[3:4])
        else:
            values = [float(field) for field in line.split()]
            stamps.append(values[0])
            values = values[1:8]
            quaternions.append(values[3:7])
        positions.append(values[:3])
    return Poses(stamps, positions, quaternions)


def read_extrinsics_truth(path):
    """(p, q) of T_imu_cam from EuRoC's cam0/sensor.yaml, a Kalibr camchain, or the simulator's truth."""
    data = yaml.safe_load(pathlib.Path(path).read_text())
    camera = data.get('cam0', data)
    if 'T_BS' in data:
        T = np.array(data['T_BS']['data'], float).reshape(4, 4)
    elif 'T_imu_cam' in camera:
        T = np.array(camera['T_imu_cam'], float).reshape(4, 4)
    elif 'T_cam_imu' in camera:
        T = np.linalg.inv(np.array(camera['T_cam_imu'], float).reshape(4, 4))
    else:
        raise ValueError('%s: neither T_BS nor T_imu_cam nor T_cam_imu' % path)
    return T[:3, 3], quaternion_from_matrix(T[:3, :3]), float(camera.get('timeshift_cam_imu', 0.0))


def align_yaw(estimate, truth):
    """Yaw [rad] and translation [m] that bring the estimate's positions nearest to the truth's."""
    e = estimate.positions - estimate.positions.mean(axis=0)
    t = truth.positions - truth.positions.mean(axis=0)
    yaw = math.atan2(np.sum(e[:, 0] * t[:, 1] - e[:, 1] * t[:, 0]), np.sum(e[:, 0] * t[:, 0] + e[:, 1] * t[:, 1]))
    rotation = yaw_matrix(yaw)
    return yaw, truth.positions.mean(axis=0) - rotation @ estimate.positions.mean(axis=0)


def yaw_matrix(yaw):
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])


def scale_needed(estimate, truth):
    """Scale of the similarity that fits best (Umeyama): 1 is perfect."""
    e = estimate.positions - estimate.positions.mean(axis=0)
    t = truth.positions - truth.positions.mean(axis=0)
    U, D, Vt = np.linalg.svd(t.T @ e)
    signs = np.array([1, 1, np.sign(np.linalg.det(U @ Vt))])
    return float(np.sum(D * signs) / max(np.sum(e * e), 1e-12))


def score_odometry(odometry, truth, start=None, end=None):
    """Figures of a trajectory; `start` and `end` [s] bound the data that was offered (default: the truth's span)."""
    start = truth.stamps[0] if start is None else max(start, truth.stamps[0])
    end = truth.stamps[-1] if end is None else min(end, truth.stamps[-1])
    if len(odometry) < 2 or len(truth) < 2:
        return {'poses': len(odometry), 'coverage': 0.0}
    reference, covered = truth.at(odometry.stamps)
    estimate, reference = odometry.only(covered), reference.only(covered)
    if len(estimate) < 2:
        return {'poses': len(odometry), 'coverage': 0.0}
    yaw, translation = align_yaw(estimate, reference)
    error = estimate.positions @ yaw_matrix(yaw).T + translation - reference.positions
    distance = np.linalg.norm(error, axis=1)
    turn = np.array([0, 0, math.sin(yaw / 2), math.cos(yaw / 2)])
    aligned = multiply(np.broadcast_to(turn, estimate.quaternions.shape), estimate.quaternions)
    angle = np.linalg.norm(log(multiply(inverse(reference.quaternions), aligned)), axis=1)
    length = float(np.linalg.norm(np.diff(reference.positions, axis=0), axis=1).sum())
    ate = float(np.sqrt(np.mean(distance ** 2)))
    return {
        'poses': len(estimate),
        'first_pose_s': float(odometry.stamps[0] - start),
        'coverage': float((estimate.stamps[-1] - estimate.stamps[0]) / (end - start)),
        'largest_gap_s': float(np.max(np.diff(odometry.stamps))),
        'ate_m': ate,
        'largest_error_m': float(distance.max()),
        'attitude_deg': float(np.degrees(np.sqrt(np.mean(angle ** 2)))),
        'scale': scale_needed(estimate, reference),
        'length_m': length,
        'ate_percent': 100.0 * ate / max(length, 1e-9),
    }


class Extrinsics:
    """extrinsics.csv: stamps [s], T_imu_cam with sigmas [m, rad], td [s] and the state, one row per image."""

    def __init__(self, path):
        with open(path, newline='') as file:
            rows = [row for row in csv.reader(file) if row and row[0][0].isdigit()]
        values = np.array([[float(field) for field in row[:16]] for row in rows]).reshape(-1, 16)
        self.stamps, self.positions = values[:, 0], values[:, 1:4]
        self.quaternions = values[:, 4:8]
        self.sigma_positions, self.sigma_rotations = values[:, 8:11], values[:, 11:14]
        self.td, self.sigma_td = values[:, 14], values[:, 15]
        self.states = [row[16].strip() for row in rows]

    def __len__(self):
        return len(self.stamps)

    def errors(self, p, q):
        """Position [m] and rotation [rad, right perturbation] errors, N x 3 each."""
        rotation = log(multiply(np.broadcast_to(inverse(q), self.quaternions.shape), normalized(self.quaternions)))
        return self.positions - p, rotation


def score_extrinsics(extrinsics, truth, start=None, rotation_deg=0.5, position_m=0.02):
    """Figures of a calibration; `truth` is (p, q, td). Times count from `start` (default: the first image)."""
    if not len(extrinsics):
        return {}
    p, q, td = truth
    start = extrinsics.stamps[0] if start is None else start
    position, rotation = extrinsics.errors(p, q)
    degrees = np.degrees(np.linalg.norm(rotation, axis=1))
    metres = np.linalg.norm(position, axis=1)
    outside = np.flatnonzero((degrees > rotation_deg) | (metres > position_m))
    settled = outside[-1] + 1 if len(outside) else 0
    said = [i for i, state in enumerate(extrinsics.states) if state == 'converged']
    rotation_sigmas = np.max(np.abs(rotation) / np.maximum(extrinsics.sigma_rotations, 1e-12), axis=1)
    position_sigmas = np.max(np.abs(position) / np.maximum(extrinsics.sigma_positions, 1e-12), axis=1)
    out = {
        'rotation_deg': float(degrees[-1]),
        'translation_m': float(metres[-1]),
        'td_ms': float(1e3 * (extrinsics.td[-1] - td)),
        'rotation_sigmas': float(rotation_sigmas[-1]),
        'translation_sigmas': float(position_sigmas[-1]),
        'within_bounds_s': float(extrinsics.stamps[settled] - start) if settled < len(extrinsics) else None,
        'says_converged_s': float(extrinsics.stamps[said[0]] - start) if said else None,
        'final_state': extrinsics.states[-1],
    }
    if said:
        out['rotation_when_converged_deg'] = float(degrees[said[0]])
        out['translation_when_converged_m'] = float(metres[said[0]])
        out['rotation_sigmas_when_converged'] = float(rotation_sigmas[said[0]])
        out['translation_sigmas_when_converged'] = float(position_sigmas[said[0]])
        # Of the six axes, the share whose error then was within three sigmas.
        out['within_3_sigma_when_converged'] = float(np.mean(np.abs(np.concatenate(
            [position[said[0]] / np.maximum(extrinsics.sigma_positions[said[0]], 1e-12),
             rotation[said[0]] / np.maximum(extrinsics.sigma_rotations[said[0]], 1e-12)])) <= 3.0))
    return out
