#!/usr/bin/python3
"""The services answer, before the intrinsics are known and after; a refused request says why."""
import threading
import unittest

import rospy
import rostest
from sensor_msgs.msg import CameraInfo

from autocal_vio.msg import CalibrationStatus
from autocal_vio.srv import FreezeExtrinsics, Reset, SaveCalibration

from ros_test_support import Collector, Sensors


def camera_info(distortion_model):
    info = CameraInfo(width=752, height=480, distortion_model=distortion_model, D=[-0.28, 0.07, 0.0002, 0.00002, 0.01])
    info.K = [458.654, 0, 367.215, 0, 457.296, 248.375, 0, 0, 1]
    return info


class Services(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        for name in ('reset', 'freeze_extrinsics', 'save_calibration'):
            rospy.wait_for_service('/vio/' + name, 20.0)
        cls.reset = rospy.ServiceProxy('/vio/reset', Reset)
        cls.freeze = rospy.ServiceProxy('/vio/freeze_extrinsics', FreezeExtrinsics)
        cls.save = rospy.ServiceProxy('/vio/save_calibration', SaveCalibration)
        cls.statuses = Collector('/vio/calibration_status', CalibrationStatus)
        cls.info_publisher = rospy.Publisher('/cam0/camera_info', CameraInfo, queue_size=1, latch=True)
        cls.sensors = Sensors()

    def test_1_nothing_to_serve_without_intrinsics(self):
        self.assertIsNotNone(self.statuses.wait(lambda s: 'waiting for /cam0/camera_info' in s.reason))
        answer = self.reset(keep_calibration=True)
        self.assertFalse(answer.success)
        self.assertIn('intrinsics', answer.message)

    def test_2_a_camera_info_that_cannot_be_used_is_named(self):
        self.info_publisher.publish(camera_info('omni'))
        self.assertIsNotNone(self.statuses.wait(lambda s: 'omni' in s.reason))

    def test_3_intrinsics_from_camera_info(self):
        self.info_publisher.publish(camera_info('plumb_bob'))
        self.assertIsNotNone(self.statuses.wait(lambda s: s.images_processed > 3))

    def test_4_reset(self):
        for keep in (True, False):
            resets = self.statuses.last().resets
            answer = self.reset(keep_calibration=keep)
            self.assertTrue(answer.success, answer.message)
            self.assertIsNotNone(self.statuses.wait(lambda s, before=resets: s.resets > before))

    def test_5_freeze_and_release(self):
        answer = self.freeze(rotation=True, translation=False, time_offset=True)
        self.assertFalse(answer.success)
        self.assertIn('no extrinsics to hold yet', answer.message)
        answer = self.freeze(rotation=False, translation=False, time_offset=True)
        self.assertTrue(answer.success, answer.message)
        self.assertIn('held: time offset (sigma ', answer.message)
        self.assertTrue(self.freeze(rotation=False, translation=False, time_offset=False).success)

    def test_6_save_says_why_not(self):
        answer = self.save()
        self.assertFalse(answer.success)
        self.assertIn('camchain_path', answer.message)
        answer = self.save(camchain_path='/proc/nowhere/camchain.yaml')
        self.assertFalse(answer.success)
        self.assertTrue(answer.message)

    def test_7_many_requests_at_once_under_data(self):
        answers = []

        def ask():
            for _ in range(5):
                answers.append(self.reset(keep_calibration=True).success)

        threads = [threading.Thread(target=ask) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertEqual(answers, [True] * 20)
        processed = self.statuses.last().images_processed
        self.assertIsNotNone(self.statuses.wait(lambda s: s.images_processed > processed + 2))


if __name__ == '__main__':
    rospy.init_node('test_services')
    rostest.rosrun('autocal_vio', 'test_services', Services)
