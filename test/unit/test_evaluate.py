#!/usr/bin/python3
"""The program evaluate: files and bags of known error, and what it says about those it cannot read."""
import json
import math
import pathlib
import subprocess
import tempfile
import unittest

import numpy as np
import rosbag
import rospy
from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped
from nav_msgs.msg import Odometry
from tf2_msgs.msg import TFMessage

from autocal_vio.msg import CalibrationStatus

PROGRAM = pathlib.Path(__file__).resolve().parents[2] / 'scripts' / 'evaluate'
HEADING = 'stamp_s,px,py,pz,qx,qy,qz,qw,sigma_px,sigma_py,sigma_pz,sigma_rx,sigma_ry,sigma_rz,td,sigma_td,state\n'
STAMPS = 1000.0 + 0.05 * np.arange(200)
# T_imu_cam: a quarter turn about z, 0.1 m along x of the IMU.
SENSOR = '%YAML:1.0\nT_BS:\n  data: [0, -1, 0, 0.1, 1, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\n'
QUARTER = [0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)]


def position(t):
    return [math.sin(t), math.sin(2 * t), 0.1 * math.cos(t)]


class Evaluate(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        truth = ['#timestamp,p,q']
        for stamp in 1000.0 + 0.005 * np.arange(-200, 2400):
            truth.append('%d,%.12f,%.12f,%.12f,1,0,0,0' % (round(1e9 * stamp), *position(stamp)))
        self.truth = self.write('truth.csv', '\n'.join(truth))
        self.sensor = self.write('sensor.yaml', SENSOR)

    def write(self, name, text):
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        return path

    def tum(self, scale=1.0, shift=0.0):
        rows = ['%.9f %.12f %.12f %.12f 0 0 0 1' % (stamp + shift, *(scale * np.array(position(stamp)) + [4, 5, 6]))
                for stamp in STAMPS]
        return '\n'.join(rows) + '\n'

    def run_program(self, *arguments):
        return subprocess.run(['/usr/bin/python3', PROGRAM, *map(str, arguments)], capture_output=True, text=True, timeout=60)

    def figures(self, *arguments):
        run = self.run_program('--json', *arguments)
        self.assertEqual(run.returncode, 0, run.stderr)
        return json.loads(run.stdout)

    def refusal(self, *arguments):
        run = self.run_program(*arguments)
        self.assertEqual(run.returncode, 1, run.stdout + run.stderr)
        self.assertEqual(run.stderr.count('\n'), 1, run.stderr)
        return run.stderr

    def write_results(self):
        self.write('results/odometry.tum', self.tum(scale=1.1))
        row = ','.join(map(str, [0.1, 0.003, 0.004, *QUARTER, 0.002, 0.002, 0.002, 0.001, 0.001, 0.001, 0.002, 0.001]))
        self.write('results/extrinsics.csv', HEADING + ''.join(
            '%.9f,%s,%s\n' % (stamp, row, 'converged' if k >= 100 else 'estimating') for k, stamp in enumerate(STAMPS)))
        return self.folder / 'results'

    def test_folder_of_results(self):
        out = self.folder / 'plots'
        arguments = (self.write_results(), '--truth', self.truth, '--extrinsics-truth', self.sensor)
        figures = self.figures(*arguments, '--plots', out)
        self.assertAlmostEqual(figures['scale'], 1 / 1.1, 6)
        self.assertAlmostEqual(figures['translation_m'], 0.005, 9)
        self.assertAlmostEqual(figures['translation_sigmas'], 2.0, 6)
        self.assertAlmostEqual(figures['rotation_deg'], 0.0, 6)
        self.assertAlmostEqual(figures['td_ms'], 2.0, 6)
        self.assertAlmostEqual(figures['says_converged_s'], 5.0, 6)
        self.assertAlmostEqual(figures['coverage'], 1.0, 6)
        self.assertEqual([row['over'] for row in figures['rpe']], ['1 s', '5 s', '1 m', '5 m', '10 m'])
        for name in ('trajectory.png', 'errors.png', 'calibration_error.png'):
            content = (out / name).read_bytes()
            self.assertEqual(content[:8], b'\x89PNG\r\n\x1a\n')
            self.assertGreater(len(content), 10000)
        tables = self.run_program(*arguments)
        self.assertEqual(tables.returncode, 0, tables.stderr)
        for text in ('ATE', 'RPE', 'T_imu_cam', 'T_cam_imu', 'scale'):
            self.assertIn(text, tables.stdout)

    def test_trajectory_alone(self):
        figures = self.figures(self.write('a.txt', self.tum()), '--truth', self.truth)
        self.assertLess(figures['ate_m'], 1e-6)
        self.assertEqual(figures['poses'], 200)
        figures = self.figures(self.truth, '--truth', self.write('b.txt', self.tum()))
        self.assertLess(figures['ate_m'], 1e-3)  # straight lines between poses at 20 Hz

    def test_wrong_files_are_named_with_the_line(self):
        good = self.write('good.tum', self.tum())
        for text, line, reason in (('1 2 3\n', 1, 'found 3 columns'), ('# a\n1 0 0 0 0 0 0 1\n2 0 x 0 0 0 0 1\n', 3, "'x'"),
                                   ('1 0 nan 0 0 0 0 1\n', 1, 'not finite'), ('1 0 0 0 0 0 0 2\n', 1, 'has not the length 1'),
                                   ('1403636580838555648 0 0 0 0 0 0 1\n', 1, 'not in seconds'),
                                   ('1403636580.8,0,0,0,1,0,0,0\n', 1, 'nanoseconds'), ('1,0,0\n', 1, 'found 3 columns'),
                                   (HEADING, 1, 'table of extrinsics')):
            said = self.refusal(self.write('bad', text), '--truth', self.truth)
            self.assertIn('bad:%d: ' % line, said)
            self.assertIn(reason, said)
        self.assertIn('nowhere: No such file', self.refusal(good, '--truth', 'nowhere'))
        self.assertIn('extrinsics.csv: No such file', self.refusal(self.folder, '--truth', self.truth))
        self.assertIn('T_cam_imu', self.refusal(self.write_results(), '--extrinsics-truth', self.write('c.yaml', 'a: 1\n')))
        self.assertIn('no rotation', self.refusal(self.write_results(), '--extrinsics-truth',
                                                  self.write('d.yaml', SENSOR.replace('-1,', '1,'))))

    def test_wrong_extrinsics_are_named(self):
        results, eye = self.write_results(), '[[1,0,0,%s],[0,1,0,0],[0,0,%s,0],[%s,0,0,1]]'
        for text, reason in (('cam0:\n', 'cam0 is no map'), ('cam0: [1]\n', 'cam0 is no map'), ('T_BS: [1, 2, 3]\n', 'T_BS is no 4x4'),
                             ('T_BS:\n', 'T_BS is no 4x4'),
                             ('T_cam_imu: ' + eye % ('.nan', 1, 0), 'T_cam_imu is not finite'),
                             ('T_imu_cam: ' + eye % (0, '.nan', 0), 'T_imu_cam is not finite'),
                             ('T_imu_cam: ' + eye % (0, 1, 0.1), 'last row of T_imu_cam'),
                             ('T_imu_cam: %s\ntimeshift_cam_imu: abc\n' % (eye % (0, 1, 0)), 'timeshift_cam_imu is no number'),
                             ('T_imu_cam: %s\ntimeshift_cam_imu:\n' % (eye % (0, 1, 0)), 'timeshift_cam_imu is no number'),
                             ('T_imu_cam: %s\ntimeshift_cam_imu: .inf\n' % (eye % (0, 1, 0)), 'timeshift_cam_imu is not finite')):
            said = self.refusal(results, '--extrinsics-truth', self.write('e.yaml', text))
            self.assertIn('e.yaml: ', said)
            self.assertIn(reason, said)

    def test_a_hole_in_the_odometry(self):
        """14 s of 20: what is left is 6 s."""
        truth = self.write('long.tum', ''.join('%.3f %.9f %.9f %.9f 0 0 0 1\n' % (1000.0 + t, *position(t))
                                               for t in 0.01 * np.arange(2001)))
        rows = ['%.3f %.9f %.9f %.9f 0 0 0 1' % (1000.0 + t, *position(t)) for t in 0.05 * np.arange(401)
                if t < 3.001 or t > 16.999]
        figures = self.figures(self.write('hole.tum', '\n'.join(rows)), '--truth', truth)
        self.assertAlmostEqual(figures['coverage'], 6.0 / 20.0, 6)
        self.assertAlmostEqual(figures['largest_gap_s'], 14.0, 6)

    def test_files_without_a_pose(self):
        self.assertIn('empty.tum: has no pose', self.refusal(self.write('empty.tum', '# nothing\n'), '--truth', self.truth))
        results = self.write_results()
        self.write('results/odometry.tum', '')
        self.assertIn('odometry.tum: has no pose', self.refusal(results, '--truth', self.truth))
        # The calibration alone is a result, too.
        run = self.run_program('--json', results, '--truth', self.truth, '--extrinsics-truth', self.sensor)
        self.assertEqual(run.returncode, 0, run.stderr)
        self.assertIn('odometry.tum: has no pose', run.stderr)
        self.assertAlmostEqual(json.loads(run.stdout)['translation_m'], 0.005, 9)

    def test_repeated_stamps_are_noted(self):
        run = self.run_program('--json', self.write('twice.tum', self.tum() + self.tum(scale=2.0)), '--truth', self.truth)
        self.assertEqual(run.returncode, 0, run.stderr)
        self.assertIn('poses whose stamp came before: 200, left out', run.stderr)
        self.assertAlmostEqual(json.loads(run.stdout)['scale'], 1.0, 6)

    def test_a_byte_order_mark_is_skipped(self):
        mark = '\ufeff'
        figures = self.figures(self.write('a.tum', mark + self.tum()), '--truth',
                               self.write('b.csv', mark + self.truth.read_text()))
        self.assertEqual(figures['poses'], 200)
        sensor = self.write('c.yaml', mark + SENSOR)
        self.assertAlmostEqual(self.figures(self.write_results(), '--extrinsics-truth', sensor)['translation_m'], 0.005, 9)

    def test_no_overlap_in_time(self):
        said = self.refusal(self.write('late.tum', self.tum(shift=100.0)), '--truth', self.truth)
        self.assertIn('no overlap in time: the odometry goes from 1100.000 to 1109.950 s', said)

    def test_wrong_units_are_noted(self):
        run = self.run_program(self.write('mm.tum', self.tum(scale=1000.0)), '--truth', self.truth)
        self.assertEqual(run.returncode, 0)
        self.assertIn('metres?', run.stderr)

    def results(self, states, pose, sigma):
        rows = ['%.9f,%s,%s,0.001,0.001,%s' % (stamp, ','.join('%.9f' % value for value in pose),
                                              ','.join('%g' % value for value in sigma), states) for stamp in STAMPS]
        return self.write('estimate.csv', HEADING + '\n'.join(rows) + '\n')

    def test_a_truth_the_wrong_way_round_is_noted(self):
        back = [0.0, 0.1, 0.0, 0.0, 0.0, -QUARTER[2], QUARTER[3]]
        table = self.results('converged', back, 3 * [0.001] + 3 * [0.001])
        run = self.run_program(self.write('a.tum', self.tum()), '--extrinsics', table, '--extrinsics-truth', self.sensor)
        self.assertIn('agrees with the inverse of this truth', run.stderr)
        right = self.results('converged', [0.1, 0.0, 0.0] + QUARTER, 3 * [0.001] + 3 * [0.001])
        run = self.run_program(self.write('a.tum', self.tum()), '--extrinsics', right, '--extrinsics-truth', self.sensor)
        self.assertNotIn('inverse', run.stderr)

    def test_what_was_never_estimated_is_not_scored(self):
        table = self.results('calibrating_rotation', 6 * [0.0] + [1.0], 3 * [1000.0] + 3 * [1.815])
        run = self.run_program(self.write('a.tum', self.tum()), '--extrinsics', table, '--extrinsics-truth', self.sensor)
        self.assertEqual(run.returncode, 0, run.stderr)
        self.assertIn('the calibration was never estimated', run.stderr)
        self.assertRegex(run.stdout, r'rotation camera-IMU, error +-\n')
        self.assertRegex(run.stdout, r'translation camera-IMU, error +-\n')
        self.assertIn('estimate   none', run.stdout)

    def test_nothing_to_compare_with(self):
        run = self.run_program(self.write('a.tum', self.tum()))
        self.assertEqual(run.returncode, 2)
        self.assertIn('--truth', run.stderr)

    def write_bag(self, calibration):
        """Odometry of scale 1.1; the calibration (3 mm, 4 mm) off, with a covariance in the IMU's axes."""
        path = self.folder / 'recorded.bag'
        with rosbag.Bag(str(path), 'w') as bag:
            for stamp in STAMPS:
                time = rospy.Time.from_sec(stamp)
                odometry = Odometry()
                odometry.header.stamp, odometry.child_frame_id = time, 'imu0'
                place = odometry.pose.pose.position
                place.x, place.y, place.z = 1.1 * np.array(position(stamp))
                odometry.pose.pose.orientation.w = 1.0
                bag.write('/vio/odometry', odometry, time)
                truth = Odometry()
                truth.header.stamp = time
                truth.pose.pose.position.x, truth.pose.pose.position.y, truth.pose.pose.position.z = position(stamp)
                truth.pose.pose.orientation.w = 1.0
                bag.write('/truth', truth, time)
                calibration(bag, time)
        return path

    @staticmethod
    def fill_pose(pose):
        pose.position.x, pose.position.y, pose.position.z = 0.1, 0.003, 0.004
        pose.orientation.z, pose.orientation.w = QUARTER[2:]

    def test_bag_with_status(self):
        def calibration(bag, time):
            status = CalibrationStatus(state='estimating', time_offset=0.003, sigma_time_offset=0.001)
            status.header.stamp = time
            self.fill_pose(status.T_imu_cam)
            status.T_imu_cam_covariance = np.diag([1e-6, 4e-6, 4e-6, 1e-6, 4e-6, 9e-6]).ravel().tolist()
            bag.write('/vio/calibration_status', status, time)

        path = self.write_bag(calibration)
        figures = self.figures(path, '--truth', self.truth, '--extrinsics-truth', self.sensor)
        self.assertAlmostEqual(figures['scale'], 1 / 1.1, 6)
        self.assertAlmostEqual(figures['translation_m'], 0.005, 9)
        self.assertAlmostEqual(figures['translation_sigmas'], 2.0, 6)
        self.assertAlmostEqual(figures['td_ms'], 3.0, 6)
        self.assertEqual(figures['final_state'], 'estimating')
        self.assertAlmostEqual(self.figures(path, '--truth-topic', '/truth', '--odometry-topic', '/vio/odometry')['scale'],
                               1 / 1.1, 6)

    def test_bag_with_extrinsics(self):
        def calibration(bag, time):
            message = PoseWithCovarianceStamped()
            message.header.stamp = time
            self.fill_pose(message.pose.pose)
            message.pose.covariance = np.diag([1e-6, 4e-6, 4e-6, 1e-6, 4e-6, 9e-6]).ravel().tolist()
            bag.write('/vio/extrinsics', message, time)

        figures = self.figures(self.write_bag(calibration), '--extrinsics-truth', self.sensor)
        self.assertAlmostEqual(figures['translation_sigmas'], 2.0, 6)
        self.assertIsNone(figures['td_ms'])

    def test_bag_with_tf_alone(self):
        def calibration(bag, time):
            transform = TransformStamped()
            transform.header.stamp, transform.header.frame_id, transform.child_frame_id = time, 'imu0', 'cam0'
            transform.transform.translation.x = 0.1
            transform.transform.rotation.z, transform.transform.rotation.w = QUARTER[2:]
            bag.write('/tf', TFMessage([transform]), time)

        path = self.write_bag(calibration)
        figures = self.figures(path, '--truth', self.truth, '--extrinsics-truth', self.sensor)
        self.assertAlmostEqual(figures['translation_m'], 0.0, 9)
        self.assertIsNone(figures['rotation_sigmas'])
        self.assertIn('cam7', self.refusal(path, '--extrinsics-truth', self.sensor, '--camera-frame', 'cam7'))

    def test_missing_topics_list_those_there_are(self):
        path = self.write_bag(lambda bag, time: None)
        said = self.refusal(path, '--truth', self.truth, '--odometry-topic', '/odom')
        self.assertIn('no topic /odom; its topics: /truth (nav_msgs/Odometry), /vio/odometry (nav_msgs/Odometry)', said)
        self.assertIn('no recorded calibration', self.refusal(path, '--extrinsics-truth', self.sensor))
        self.assertIn('cannot be read as a bag', self.refusal(self.write('no.bag', 'text'), '--truth', self.truth))


unittest.main()
