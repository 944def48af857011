"""Scores what the estimator wrote (odometry.tum, extrinsics.csv) against the truth.

Frames as in docs/notation.md: T_AB takes coordinates in B to A; quaternions are x y z w rows of an array.
Position errors are taken after an alignment with four degrees of freedom (yaw and position): roll, pitch and scale are
observable with an IMU and get no help.
"""
import math

import numpy as np

# Truth further apart than this is not interpolated [s].
LARGEST_TRUTH_GAP_S = 0.2
# Poses further apart than this many of their median periods have a hole between them.
LARGEST_PERIODS = 5.0


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


def rotation_matrix(q):
    """3x3 of one unit quaternion."""
    x, y, z, w = q
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])


def yaw_pitch_roll(R):
    """Angles [rad] of R = Rz(yaw) Ry(pitch) Rx(roll)."""
    return (math.atan2(R[1, 0], R[0, 0]), math.atan2(-R[2, 0], math.hypot(R[0, 0], R[1, 0])), math.atan2(R[2, 1], R[2, 2]))


class Poses:
    """A trajectory: stamps [s] (N), positions [m] (N x 3), quaternions (N x 4).

    Of poses with the same stamp the first counts; `repeated` is how many were left out.
    """

    def __init__(self, stamps, positions, quaternions):
        order = np.unique(stamps, return_index=True)[1]
        self.repeated = len(stamps) - len(order)
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


class Comparison:
    """A trajectory beside the truth at the stamps that both cover.

    `estimate` is aligned (yaw and position), `reference` the truth; `position_error` [m] in the truth's axes, `attitude_error`
    [rad] about the axes of the body, N x 3 each. Needs two common poses: `possible` says whether there are.
    """

    def __init__(self, odometry, truth):
        self.possible = False
        if len(odometry) < 2 or len(truth) < 2:
            return
        reference, covered = truth.at(odometry.stamps)
        estimate, self.reference = odometry.only(covered), reference.only(covered)
        if len(estimate) < 2:
            return
        self.possible = True
        self.scale = scale_needed(estimate, self.reference)
        yaw, translation = align_yaw(estimate, self.reference)
        turn = np.array([0, 0, math.sin(yaw / 2), math.cos(yaw / 2)])
        self.estimate = Poses(estimate.stamps, estimate.positions @ yaw_matrix(yaw).T + translation,
                              multiply(np.broadcast_to(turn, estimate.quaternions.shape), estimate.quaternions))
        self.position_error = self.estimate.positions - self.reference.positions
        self.attitude_error = log(multiply(inverse(self.reference.quaternions), self.estimate.quaternions))

    def travelled(self):
        """Distance that the truth has covered at each pose [m]."""
        steps = np.linalg.norm(np.diff(self.reference.positions, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])


def time_covered(stamps):
    """Time [s] during which poses follow each other: without the holes."""
    steps = np.diff(stamps)
    return float(np.sum(steps[steps <= LARGEST_PERIODS * np.median(steps)]))


def score_odometry(odometry, truth, start=None, end=None):
    """Figures of a trajectory; `start` and `end` [s] bound the data that was offered (default: the truth's span).

    The coverage is a share of the time between them, or of what the truth has of it.
    """
    comparison = Comparison(odometry, truth)
    if not comparison.possible:
        return {'poses': len(odometry), 'coverage': 0.0}
    start = truth.stamps[0] if start is None else max(start, truth.stamps[0])
    end = truth.stamps[-1] if end is None else min(end, truth.stamps[-1])
    estimate = comparison.estimate
    distance = np.linalg.norm(comparison.position_error, axis=1)
    angle = np.linalg.norm(comparison.attitude_error, axis=1)
    length = float(comparison.travelled()[-1])
    ate = float(np.sqrt(np.mean(distance ** 2)))
    return {
        'poses': len(estimate),
        'first_pose_s': float(odometry.stamps[0] - start),
        'coverage': time_covered(estimate.stamps) / float(end - start),
        'largest_gap_s': float(np.max(np.diff(odometry.stamps))),
        'ate_m': ate,
        'largest_error_m': float(distance.max()),
        'attitude_deg': float(np.degrees(np.sqrt(np.mean(angle ** 2)))),
        'scale': comparison.scale,
        'length_m': length,
        'ate_percent': 100.0 * ate / max(length, 1e-9),
    }


def relative_errors(comparison, ends):
    """Errors of the relative poses from pose i to pose ends[i] (below zero: none): position [m], rotation [rad], per pair."""
    first = np.flatnonzero(ends >= 0)
    last = ends[first]

    def relative(poses):
        q = inverse(poses.quaternions[first])
        step = poses.positions[last] - poses.positions[first]
        vector = np.column_stack([step, np.zeros(len(step))])
        return multiply(multiply(q, vector), inverse(q))[:, :3], multiply(q, poses.quaternions[last])

    p, q = relative(comparison.estimate)
    p_true, q_true = relative(comparison.reference)
    # Position in the frame of the true end, as (T_true)^-1 T has it; its length is that of the difference.
    return np.linalg.norm(p - p_true, axis=1), np.linalg.norm(log(multiply(inverse(q_true), q)), axis=1)


def later(measure, distance, tolerance):
    """For each pose the first one `distance` further on in `measure` (time or way); -1 where none is within `tolerance`."""
    ends = np.searchsorted(measure, measure + distance - 1e-9)
    found = np.minimum(ends, len(measure) - 1)
    good = (ends < len(measure)) & (measure[found] - measure - distance <= tolerance)
    return np.where(good, found, -1)


def score_relative(odometry, truth, times_s=(1.0, 5.0, 10.0), lengths_m=(1.0, 5.0, 10.0)):
    """RPE: root mean square errors of relative poses over times [s] and over lengths of the truth's way [m].

    A list of {over, pairs, translation_m, rotation_deg[, translation_percent]}, only of those that the data are long enough for.
    """
    comparison = Comparison(odometry, truth)
    if not comparison.possible:
        return []
    way = comparison.travelled()
    stamps = comparison.estimate.stamps - comparison.estimate.stamps[0]
    rows = []
    for measure, unit, distances in ((stamps, 's', times_s), (way, 'm', lengths_m)):
        for distance in distances:
            translation, rotation = relative_errors(comparison, later(measure, distance, 0.1 * distance))
            if not len(translation):
                continue
            row = {'over': '%g %s' % (distance, unit), 'pairs': len(translation),
                   'translation_m': float(np.sqrt(np.mean(translation ** 2))),
                   'rotation_deg': float(np.degrees(np.sqrt(np.mean(rotation ** 2))))}
            if unit == 'm':
                row['translation_percent'] = 100.0 * row['translation_m'] / distance
            rows.append(row)
    return rows


class Extrinsics:
    """Estimates of T_imu_cam, one per image: stamps [s], positions [m], quaternions, sigmas (position [m, in the IMU frame],
    rotation [rad, about the camera's axes]), td with its sigma [s], and the state. A sigma that nobody told is not a number."""

    def __init__(self, values, states):
        """`values`: N x 16, in the columns of extrinsics.csv."""
        values = np.asarray(values, float).reshape(-1, 16)
        self.stamps, self.positions = values[:, 0], values[:, 1:4]
        self.quaternions = values[:, 4:8]
        self.sigma_positions, self.sigma_rotations = values[:, 8:11], values[:, 11:14]
        self.td, self.sigma_td = values[:, 14], values[:, 15]
        self.states = list(states)

    def __len__(self):
        return len(self.stamps)

    def unknown(self):
        """Whether the last rotation, and the last position, are not estimated: their sigmas say nothing."""
        return (bool(np.any(self.sigma_rotations[-1] > UNKNOWN_ROTATION_RAD)),
                bool(np.any(self.sigma_positions[-1] > UNKNOWN_POSITION_M)))

    def agrees_with_inverse(self, p, q):
        """Whether the last estimate is far nearer to the inverse of (p, q) than to it: the truth is the wrong way round."""
        if any(self.unknown()):
            return False
        back = inverse(q)
        distances = []
        for position, rotation in (self.errors(p, q), self.errors(-rotation_matrix(back) @ p, back)):
            # A radian of rotation counts as much as a metre: both come with every confusion.
            distances.append(np.linalg.norm(position[-1]) + np.linalg.norm(rotation[-1]))
        return distances[1] < 0.1 and distances[1] < 0.25 * distances[0]

    def errors(self, p, q):
        """Position [m] and rotation [rad, right perturbation] errors, N x 3 each."""
        rotation = log(multiply(np.broadcast_to(inverse(q), self.quaternions.shape), normalized(self.quaternions)))
        return self.positions - p, rotation


# Sigmas beyond which a part of the extrinsics was not estimated [m, rad].
UNKNOWN_POSITION_M, UNKNOWN_ROTATION_RAD = 100.0, 1.0


def known(value):
    """None for what nobody told (not a number)."""
    return float(value) if np.isfinite(value) else None


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
    no_rotation, no_position = extrinsics.unknown()
    out = {
        'rotation_deg': None if no_rotation else float(degrees[-1]),
        'translation_m': None if no_position else float(metres[-1]),
        'td_ms': known(1e3 * (extrinsics.td[-1] - td)),
        'rotation_sigmas': None if no_rotation else known(rotation_sigmas[-1]),
        'translation_sigmas': None if no_position else known(position_sigmas[-1]),
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
