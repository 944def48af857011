#!/usr/bin/python3
"""The evaluation scripts find exactly the errors that were put in."""
import math
import pathlib
import sys
import unittest

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / 'scripts' / 'lib'))
import evaluation  # noqa: E402


def rotation(axis_angle):
    angle = np.linalg.norm(axis_angle)
    axis = np.asarray(axis_angle) / max(angle, 1e-300)
    return np.append(math.sin(angle / 2) * axis, math.cos(angle / 2))


def figure_eight(stamps):
    positions = np.column_stack([np.sin(stamps), np.sin(2 * stamps), 0.3 * np.cos(stamps)])
    quaternions = np.array([rotation([0.2 * math.sin(t), 0.1, t / 3]) for t in stamps])
    return evaluation.Poses(stamps, positions, quaternions)


def moved(poses, yaw, shift, scale=1.0):
    positions = scale * poses.positions @ evaluation.yaw_matrix(yaw).T + shift
    turn = np.broadcast_to(rotation([0, 0, yaw]), poses.quaternions.shape)
    return evaluation.Poses(poses.stamps, positions, evaluation.multiply(turn, poses.quaternions))


class Odometry(unittest.TestCase):
    def setUp(self):
        self.truth = figure_eight(np.arange(0, 20, 0.005))
        self.stamps = np.arange(4.0, 18.0, 0.05)

    def test_yaw_and_position_are_free(self):
        estimate = moved(self.truth.at(self.stamps)[0], 2.1, [5, -3, 1])
        figures = evaluation.score_odometry(estimate, self.truth)
        self.assertLess(figures['ate_m'], 1e-9)
        self.assertLess(figures['attitude_deg'], 1e-6)
        self.assertAlmostEqual(figures['scale'], 1.0, 9)
        self.assertAlmostEqual(figures['first_pose_s'], 4.0, 9)
        self.assertAlmostEqual(figures['largest_gap_s'], 0.05, 9)

    def test_scale_is_an_error(self):
        estimate = moved(self.truth.at(self.stamps)[0], -0.4, [1, 2, 3], scale=1.25)
        figures = evaluation.score_odometry(estimate, self.truth)
        self.assertAlmostEqual(figures['scale'], 0.8, 9)
        centred = self.truth.at(self.stamps)[0].positions
        centred = centred - centred.mean(axis=0)
        expected = 0.25 * math.sqrt(np.mean(np.sum(centred ** 2, axis=1)))
        self.assertAlmostEqual(figures['ate_m'], expected, 9)

    def test_roll_is_an_error(self):
        tilt = rotation([math.radians(3.0), 0, 0])
        poses = self.truth.at(self.stamps)[0]
        quaternions = evaluation.multiply(poses.quaternions, np.broadcast_to(tilt, poses.quaternions.shape))
        figures = evaluation.score_odometry(evaluation.Poses(poses.stamps, poses.positions, quaternions), self.truth)
        self.assertAlmostEqual(figures['attitude_deg'], 3.0, 6)

    def test_relative_errors(self):
        """Drift of 0.1 m and 0.5 deg of yaw a second, and a scale error, on a straight way at 2 m/s."""
        stamps = np.arange(0.0, 20.0, 0.1)
        still = np.tile(rotation([0.3, -0.2, 0.9]), (len(stamps), 1))
        way = np.column_stack([2.0 * stamps, 0 * stamps, 0 * stamps])
        truth = evaluation.Poses(stamps, way, still)
        drift = way + np.column_stack([0 * stamps, 0 * stamps, 0.1 * stamps])
        rows = {row['over']: row for row in evaluation.score_relative(
            evaluation.Poses(stamps, drift, still), truth, (1.0, 5.0, 100.0), (10.0, 1000.0))}
        self.assertEqual(sorted(rows), ['1 s', '10 m', '5 s'])
        self.assertAlmostEqual(rows['1 s']['translation_m'], 0.1, 9)
        self.assertAlmostEqual(rows['5 s']['translation_m'], 0.5, 9)
        self.assertAlmostEqual(rows['10 m']['translation_m'], 0.5, 9)
        self.assertAlmostEqual(rows['10 m']['translation_percent'], 5.0, 9)
        self.assertAlmostEqual(rows['5 s']['rotation_deg'], 0.0, 6)
        self.assertEqual(rows['1 s']['pairs'], len(stamps) - 10)
        turned = np.array([evaluation.multiply(still[0], rotation([0, 0, math.radians(0.5 * t)])) for t in stamps])
        rows = evaluation.score_relative(evaluation.Poses(stamps, way, turned), truth, (4.0,), ())
        self.assertAlmostEqual(rows[0]['rotation_deg'], 2.0, 6)

    def test_relative_errors_do_not_depend_on_the_frame(self):
        poses = self.truth.at(self.stamps)[0]
        rows = evaluation.score_relative(moved(poses, 1.3, [5, -3, 1]), self.truth)
        self.assertGreaterEqual(len(rows), 5)
        for row in rows:
            self.assertLess(row['translation_m'], 1e-9)
            self.assertLess(row['rotation_deg'], 1e-6)

    def test_holes_are_not_covered(self):
        """Poses from 4 to 18 s of 20: one hole of 10 s, and every twentieth image missing."""
        stamps = self.stamps[(self.stamps < 6.001) | (self.stamps > 15.999)]
        stamps = np.delete(stamps, np.arange(10, len(stamps), 20))
        figures = evaluation.score_odometry(self.truth.at(stamps)[0], self.truth)
        self.assertAlmostEqual(figures['largest_gap_s'], 10.0, 6)
        self.assertAlmostEqual(figures['coverage'], (2.0 + 1.95) / 19.995, 6)

    def test_repeated_stamps_count_once(self):
        once = self.truth.at(self.stamps)[0]
        wrong = moved(once, 0.0, [7, 7, 7]).only(np.arange(len(once)) % 2 == 0)
        twice = evaluation.Poses(np.concatenate([once.stamps, wrong.stamps]), np.concatenate([once.positions, wrong.positions]),
                                 np.concatenate([once.quaternions, wrong.quaternions]))
        self.assertEqual(twice.repeated, len(wrong))
        figures = evaluation.score_odometry(twice, self.truth)
        self.assertEqual(figures['poses'], len(once))
        self.assertLess(figures['ate_m'], 1e-9)
        self.assertAlmostEqual(figures['coverage'], 13.95 / 19.995, 6)

    def test_no_pose_scores_no_coverage(self):
        nothing = evaluation.Poses([], [], [])
        self.assertEqual(evaluation.score_odometry(nothing, self.truth)['coverage'], 0.0)


class Calibration(unittest.TestCase):
    def extrinsics(self, rows):
        values = [[stamp, *p, *q, 0.01, 0.01, 0.01, 0.002, 0.002, 0.002, 0.004, 0.001] for stamp, p, q, _ in rows]
        return evaluation.Extrinsics(values, [row[3] for row in rows])

    def test_errors_and_times(self):
        p, q = np.array([0.1, -0.2, 0.05]), rotation([0.4, -1.0, 0.3])
        off = evaluation.multiply(q, rotation([0.0, 0.003, 0.0]))
        rows = [(100.0, p + [0.5, 0, 0], q, 'estimating'), (101.0, p, -q, 'estimating'),
                (102.0, p + [0, 0.012, 0], off, 'converged')]
        figures = evaluation.score_extrinsics(self.extrinsics(rows), (p, q, 0.001))
        self.assertAlmostEqual(figures['rotation_deg'], math.degrees(0.003), 6)
        self.assertAlmostEqual(figures['translation_m'], 0.012, 9)
        self.assertAlmostEqual(figures['rotation_sigmas'], 1.5, 6)
        self.assertAlmostEqual(figures['translation_sigmas'], 1.2, 6)
        self.assertAlmostEqual(figures['td_ms'], 3.0, 6)
        self.assertAlmostEqual(figures['within_bounds_s'], 1.0, 9)
        self.assertAlmostEqual(figures['says_converged_s'], 2.0, 9)

    def test_what_nobody_told_has_no_error(self):
        nothing = float('nan')
        values = [[1.0, 0.1, 0.2, 0.3, 0, 0, 0, 1] + 8 * [nothing]]
        figures = evaluation.score_extrinsics(evaluation.Extrinsics(values, ['']),
                                              (np.array([0.1, 0.2, 0.3]), np.array([0, 0, 0, 1.0]), 0.0))
        self.assertEqual(figures['translation_m'], 0.0)
        for name in ('td_ms', 'rotation_sigmas', 'translation_sigmas'):
            self.assertIsNone(figures[name])

    def test_quaternion_from_matrix(self):
        for axis_angle in ([0.1, 0.2, 0.3], [math.pi, 0, 0], [0, -2.0, 2.0], [0, 0, 0]):
            q = rotation(axis_angle)
            columns = [evaluation.multiply(evaluation.multiply(q, np.append(e, 0.0)), evaluation.inverse(q))[:3]
                       for e in np.eye(3)]
            recovered = evaluation.quaternion_from_matrix(np.column_stack(columns))
            self.assertLess(np.linalg.norm(evaluation.log(evaluation.multiply(evaluation.inverse(q), recovered))), 1e-9)
            self.assertLess(np.abs(evaluation.rotation_matrix(q) - np.column_stack(columns)).max(), 1e-12)

    def test_yaw_pitch_roll(self):
        yaw, pitch, roll = 2.0, -0.7, 0.4
        q = evaluation.multiply(evaluation.multiply(rotation([0, 0, yaw]), rotation([0, pitch, 0])), rotation([roll, 0, 0]))
        self.assertTrue(np.allclose(evaluation.yaw_pitch_roll(evaluation.rotation_matrix(q)), (yaw, pitch, roll), atol=1e-12))


unittest.main()
