#!/usr/bin/python3
"""Load, unload and load again, also while data pours in; two at once; the clock going back."""
import unittest

import rospy
import rostest

from autocal_vio.msg import CalibrationStatus

from ros_test_support import Collector, RosoutCollector, Sensors, load_nodelet, nodelets_of, set_parameters
from ros_test_support import unload_nodelet, wait_for

MANAGER = '/manager'


class Lifecycle(unittest.TestCase):
    def setUp(self):
        self.rig_file = rospy.get_param('/rig_file')

    def assert_processing(self, name, timeout=15.0):
        statuses = Collector(name + '/calibration_status', CalibrationStatus)
        self.assertIsNotNone(statuses.wait(lambda s: s.images_processed > 5, timeout), 'no images processed')
        statuses.close()

    def test_load_unload_load_under_data(self):
        sensors = Sensors()
        for _ in range(3):
            set_parameters('/vio', rig_file=self.rig_file)
            self.assertTrue(load_nodelet(MANAGER, '/vio'))
            self.assertIn('/vio', nodelets_of(MANAGER))
            self.assert_processing('/vio')
            self.assertTrue(unload_nodelet(MANAGER, '/vio'))
            self.assertNotIn('/vio', nodelets_of(MANAGER))
        sensors.stop()

    def test_two_side_by_side(self):
        sensors = Sensors()
        for name in ('/left', '/right'):
            set_parameters(name, rig_file=self.rig_file, publish_odom_tf=False, publish_camera_tf=False)
            self.assertTrue(load_nodelet(MANAGER, name))
        for name in ('/left', '/right'):
            self.assert_processing(name)
        self.assertTrue(unload_nodelet(MANAGER, '/left'))
        self.assert_processing('/right')
        self.assertTrue(unload_nodelet(MANAGER, '/right'))
        sensors.stop()

    def test_stamps_going_back_restart_it_once(self):
        set_parameters('/looped', rig_file=self.rig_file)
        self.assertTrue(load_nodelet(MANAGER, '/looped'))
        log = RosoutCollector()
        statuses = Collector('/looped/calibration_status', CalibrationStatus)
        sensors = Sensors()
        self.assertIsNotNone(statuses.wait(lambda s: s.images_processed > 5))
        sensors.shift = -100.0
        back = rospy.Time.now() - rospy.Duration(50.0)
        statuses.clear()

        def processed_since():
            return len({s.images_processed for s in statuses.messages() if s.header.stamp < back})

        self.assertTrue(wait_for(lambda: processed_since() > 3, 15.0), 'not processing after the jump')
        self.assertTrue(log.has('starting anew'))
        rospy.sleep(1.0)
        self.assertEqual(log.count('starting anew'), 1)
        self.assertTrue(unload_nodelet(MANAGER, '/looped'))
        sensors.stop()


if __name__ == '__main__':
    rospy.init_node('test_lifecycle')
    rostest.rosrun('autocal_vio', 'test_lifecycle', Lifecycle)
