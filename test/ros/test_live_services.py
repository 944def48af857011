#!/usr/bin/python3
"""Every service while the estimate runs, at 20 images and 200 IMU samples a second."""
import os
import pathlib
import tempfile
import threading
import time
import unittest

import numpy
import rospy
import rostest
import yaml
from nav_msgs.msg import Odometry

from autocal_vio.msg import CalibrationStatus
from autocal_vio.srv import FreezeExtrinsics, Reset, SaveCalibration

from ros_test_support import Collector, wait_for

# The IMU hangs on the base, the camera's optical frame in a body frame on a mast.
ROBOT = """<?xml version="1.0"?>
<robot name="rig">  <!-- as somebody wrote it -->
  <link name="base_link"/><link name="imu0"/><link name="mast"/><link name="cam0_body"/><link name="cam0"/>
  <joint name="imu_joint" type="fixed"><parent link="base_link"/><child link="imu0"/><origin xyz="0.1 0 0.2"/></joint>
  <joint name="mast_joint" type="fixed"><parent link="base_link"/><child link="mast"/><origin xyz="0 0 1"/></joint>
  <joint name="camera_joint" type="fixed">
    <parent link="mast"/>   <child link="cam0_body"/>
    <origin xyz="0 0 0" rpy="0 0 0"/>   <!-- to be calibrated -->
  </joint>
  <joint name="optical" type="fixed"><parent link="cam0_body"/><child link="cam0"/>
    <origin rpy="-1.5707963267948966 0 -1.5707963267948966"/></joint>
</robot>
"""


def matrix(pose):
    x, y, z, w = (getattr(pose.orientation, k) for k in 'xyzw')
    T = numpy.eye(4)
    T[:3, :3] = [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                 [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                 [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]
    T[:3, 3] = [getattr(pose.position, k) for k in 'xyz']
    return T


def calibration(status):
    """All bits of what freezing holds."""
    p, q = status.T_imu_cam.position, status.T_imu_cam.orientation
    return p.x, p.y, p.z, q.x, q.y, q.z, q.w, status.time_offset


class LiveServices(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.statuses = Collector('/vio/calibration_status', CalibrationStatus)
        services = {'reset': Reset, 'freeze_extrinsics': FreezeExtrinsics, 'save_calibration': SaveCalibration}
        for name, kind in services.items():
            rospy.wait_for_service('/vio/' + name, 20.0)
            setattr(cls, name.split('_')[0], staticmethod(rospy.ServiceProxy('/vio/' + name, kind)))
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = pathlib.Path(folder.name)
        assert cls.wait_for_state('estimating', 'converged'), 'no estimate'

    @classmethod
    def wait_for_state(cls, *states, timeout=60.0):
        return wait_for(lambda: cls.statuses.last() and cls.statuses.last().state in states, timeout)

    def assert_processing(self):
        begin = self.statuses.last().images_processed
        self.assertTrue(wait_for(lambda: self.statuses.last().images_processed > begin + 5, 10.0), 'no images processed')

    def test_1_frozen_means_every_bit(self):
        answer = self.freeze(rotation=True, translation=True, time_offset=True)
        self.assertTrue(answer.success, answer.message)
        self.assertTrue(self.wait_for_state('frozen', timeout=5.0))
        self.statuses.clear()
        begin = time.monotonic()
        rospy.sleep(10.0)
        held = [s for s in self.statuses.messages() if s.images_processed > 0]
        rate = len({s.images_processed for s in held}) / (time.monotonic() - begin)
        print('%.1f images a second while frozen' % rate)
        self.assertGreater(rate, 5.0)
        self.assertEqual({s.state for s in held}, {'frozen'})
        self.assertEqual(len({calibration(s) for s in held}), 1)
        self.assertTrue(self.freeze(rotation=False, translation=False, time_offset=False).success)
        moved = self.statuses.wait(lambda s: s.state in ('estimating', 'converged') and calibration(s) != calibration(held[0]))
        self.assertIsNotNone(moved, 'released, and it still does not move')
        self.assertLess(numpy.linalg.norm(matrix(moved.T_imu_cam) - matrix(held[0].T_imu_cam)), 0.05)

    def test_2_parts_are_held_apart(self):
        self.assertTrue(self.freeze(rotation=True, translation=False, time_offset=False).success)
        self.statuses.clear()
        first = self.statuses.wait(lambda s: True)
        moved = self.statuses.wait(lambda s: calibration(s)[:3] != calibration(first)[:3])
        self.assertIsNotNone(moved, 'the translation is held, too')
        self.assertEqual({calibration(s)[3:7] for s in self.statuses.messages()}, {calibration(first)[3:7]})
        self.assertTrue(self.freeze(rotation=False, translation=False, time_offset=False).success)

    def test_3_save(self):
        rospy.set_param('/robot_description', ROBOT)
        self.assertTrue(self.freeze(rotation=True, translation=True, time_offset=True).success)
        self.assertTrue(self.wait_for_state('frozen', timeout=5.0))
        T_imu_cam = matrix(self.statuses.last().T_imu_cam)
        camchain, urdf = self.folder / 'camchain.yaml', self.folder / 'robot.urdf'
        answer = self.save(camchain_path=str(camchain), urdf_path=str(urdf))
        self.assertTrue(answer.success, answer.message)
        self.assertIn(str(camchain), answer.message)
        self.assertIn('%s (origin of joint camera_joint)' % urdf, answer.message)
        written = yaml.safe_load(camchain.read_text())['cam0']
        self.assertLess(numpy.abs(numpy.array(written['T_cam_imu']) - numpy.linalg.inv(T_imu_cam)).max(), 1e-9)
        self.assertEqual(written['timeshift_cam_imu'], self.statuses.last().time_offset)
        lines = [(a, b) for a, b in zip(ROBOT.splitlines(), urdf.read_text().splitlines()) if a != b]
        self.assertEqual(len(lines), 1, lines)
        self.assertTrue(lines[0][1].endswith('/>   <!-- to be calibrated -->'), lines)
        # By its own reader: the URDF as the beginning of another run says the same.
        other = self.folder / 'other.urdf'
        answer = self.save(urdf_path=str(other), urdf_source=str(urdf))
        self.assertTrue(answer.success, answer.message)
        self.assertEqual(other.read_text(), urdf.read_text())
        self.assertTrue(self.freeze(rotation=False, translation=False, time_offset=False).success)

    def test_4_what_cannot_be_saved_is_named_and_the_rest_is(self):
        old = self.folder / 'old.urdf'
        old.write_text('old')
        camchain = self.folder / 'again.yaml'
        answer = self.save(camchain_path=str(camchain), urdf_path=str(old), camera_link='nobody')
        self.assertFalse(answer.success)
        self.assertIn('no link nobody', answer.message)
        self.assertIn('written: ' + str(camchain), answer.message)
        self.assertTrue(camchain.is_file())
        self.assertEqual(old.read_text(), 'old')
        answer = self.save(urdf_path='/proc/nowhere/robot.urdf')
        self.assertFalse(answer.success)
        self.assertIn('/proc/nowhere', answer.message)
        self.assertIn('cannot be read', self.save(urdf_path=str(old), urdf_source='/nowhere.urdf').message)

    def test_4b_special_files_and_swapped_links_are_refused(self):
        answer = self.save(camchain_path='/dev/null')
        self.assertFalse(answer.success)
        self.assertIn('no regular file', answer.message)
        self.assertTrue(pathlib.Path('/dev/null').is_char_device())
        pipe = self.folder / 'pipe'
        os.mkfifo(pipe)
        begin = time.monotonic()
        self.assertIn('cannot be read', self.save(urdf_path=str(self.folder / 'a.urdf'), urdf_source=str(pipe)).message)
        self.assertLess(time.monotonic() - begin, 5.0)
        camchain = self.folder / 'kept.yaml'
        self.assertTrue(self.save(camchain_path=str(camchain)).success)
        before = camchain.read_text()
        same = self.save(camchain_path=str(camchain), urdf_path='%s/./%s' % (camchain.parent, camchain.name))
        self.assertFalse(same.success, same.message)
        self.assertIn('same file', same.message)
        self.assertEqual(camchain.read_text(), before)
        self.assertFalse(self.save(camchain_path='~').success)  # a folder
        swapped = self.save(urdf_path=str(self.folder / 'a.urdf'), camera_link='imu0', imu_link='cam0')
        self.assertFalse(swapped.success)
        self.assertIn('wrong way round', swapped.message)
        both = self.save(urdf_path=str(self.folder / 'a.urdf'), camera_link='imu0', imu_link='imu0')
        self.assertIn('are both imu0', both.message)
        self.assertFalse((self.folder / 'a.urdf').exists())

    # What one service holds another saves, whether an image has come since or not.
    def test_4c_between_a_reset_and_the_next_estimate(self):
        self.assertTrue(self.reset(keep_calibration=True).success)
        held = self.freeze(rotation=True, translation=True, time_offset=True)
        self.assertTrue(held.success, held.message)
        self.assertNotIn('e+', held.message)
        saved = self.save(camchain_path=str(self.folder / 'kept.yaml'))
        self.assertTrue(saved.success, saved.message)
        self.assertTrue(self.freeze(rotation=False, translation=False, time_offset=False).success)
        self.statuses.clear()
        self.assertTrue(self.wait_for_state('estimating', 'converged', timeout=45.0), 'no estimate after the reset')

    def test_5_all_at_once(self):
        answers, slowest = [], [0.0]

        def ask(call):
            for _ in range(8):
                begin = time.monotonic()
                answers.append(call())
                slowest[0] = max(slowest[0], time.monotonic() - begin)

        calls = [lambda: self.freeze(rotation=True, translation=True, time_offset=False),
                 lambda: self.freeze(rotation=False, translation=False, time_offset=False),
                 lambda: self.save(camchain_path=str(self.folder / 'many.yaml')),
                 lambda: self.save(urdf_path=str(self.folder / 'many.urdf'))]
        threads = [threading.Thread(target=ask, args=(call,)) for call in calls]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        print('slowest answer after %.2f s' % slowest[0])
        self.assertEqual(len(answers), 32)
        self.assertEqual([a.message for a in answers if not a.success], [])
        self.assertLess(slowest[0], 5.0)
        self.assert_processing()

    def test_6_reset_twenty_times_in_a_row(self):
        self.freeze(rotation=False, translation=False, time_offset=False)
        odometry = Collector('/vio/odometry', Odometry)
        self.assertIsNotNone(odometry.wait(lambda m: True), 'no odometry before')
        before = self.statuses.last().resets
        for k in range(20):
            answer = self.reset(keep_calibration=k % 2 == 1)
            self.assertTrue(answer.success, answer.message)
            self.assertIsNotNone(self.statuses.wait(lambda s, count=before + k + 1: s.resets >= count, 5.0))
        self.assert_processing()
        self.assertEqual(self.statuses.last().resets, before + 20)
        self.statuses.clear()
        self.assertTrue(self.wait_for_state('estimating', 'converged', timeout=45.0), 'no estimate after the resets')
        self.assertIsNotNone(odometry.wait(lambda m: m.header.stamp >= self.statuses.last().header.stamp))
        self.assert_goes_on(odometry.messages())

    def assert_goes_on(self, odometry):
        """Over the longest gap, from the last pose before the resets to the first one after: no step, no turn."""
        gaps = [(b.header.stamp - a.header.stamp).to_sec() for a, b in zip(odometry, odometry[1:])]
        k = int(numpy.argmax(gaps))
        self.assertGreater(gaps[k], 0.5, 'odometry went on through the resets')
        before, after = (matrix(m.pose.pose) for m in odometry[k:k + 2])
        self.assertLess(numpy.linalg.norm(after[:3, 3] - before[:3, 3]), 1e-6, 'a jump')
        turn = after[:3, :3] @ before[:3, :3].T
        yaw = numpy.arctan2(turn[1, 0] - turn[0, 1], turn[0, 0] + turn[1, 1])
        self.assertLess(abs(yaw), 1e-6, 'another heading')


if __name__ == '__main__':
    rospy.init_node('test_live_services')
    rostest.rosrun('autocal_vio', 'test_live_services', LiveServices)
