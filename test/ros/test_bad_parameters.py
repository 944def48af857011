#!/usr/bin/python3
"""Wrong parameters: refused with words, everything at once; the manager and its other nodelets live on."""
import unittest

import rospy
import rostest

from autocal_vio.msg import CalibrationStatus

from ros_test_support import Collector, RosoutCollector, Sensors, load_nodelet, nodelets_of, set_parameters
from ros_test_support import unload_nodelet

MANAGER = '/manager'


class BadParameters(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.rig_file = rospy.get_param('/rig_file')
        cls.log = RosoutCollector()
        cls.sensors = Sensors()
        set_parameters('/neighbour', rig_file=cls.rig_file)
        assert load_nodelet(MANAGER, '/neighbour')
        cls.neighbour = Collector('/neighbour/calibration_status', CalibrationStatus)

    def refuse(self, expected, name='/bad', nodelet_type='autocal_vio/VioNodelet', **parameters):
        """The nodelet must refuse to start and log every text of `expected`."""
        self.log.clear()
        set_parameters(name, **parameters)
        self.assertFalse(load_nodelet(MANAGER, name, nodelet_type))
        self.assertNotIn(name, nodelets_of(MANAGER))
        refusal = self.log.wait(lambda log: 'refusing to start' in log.msg or expected[0] in log.msg)
        self.assertIsNotNone(refusal, 'no refusal was logged')
        for text in expected:
            self.assertIn(text, refusal.msg)
        self.neighbour.clear()
        self.assertIsNotNone(self.neighbour.wait(lambda s: s.images_processed > 0), 'the neighbour has died')

    def test_no_rig_file(self):
        self.refuse(['rig_file', 'not set'])

    def test_missing_file(self):
        self.refuse(['/nowhere/rig.yaml'], rig_file='/nowhere/rig.yaml')

    def test_file_that_is_no_rig(self):
        self.refuse(['tracker', 'initializer'], rig_file=rospy.get_param('/estimator_file'))

    def test_bad_estimator_file(self):
        self.refuse([self.rig_file], rig_file=self.rig_file, estimator_file=self.rig_file)

    def test_everything_wrong_at_once(self):
        self.refuse(['rig_file', 'queue_size', 'publish_odom_tf', 'path_length', 'odom_frame', 'misspelt'],
                    queue_size=0, publish_odom_tf='yes', path_length='long', odom_frame='imu', imu_frame='imu',
                    misspelt=1)

    def test_everything_wrong_with_the_simulated_rig(self):
        self.refuse(['image_rate', 'is no kind of motion', 'imu_path needs trajectory_path', '/nowhere/rig.yaml'],
                    name='/bad_rig', nodelet_type='autocal_vio/SimulatedRigNodelet', image_rate=-1.0, motion='dance',
                    imu_path='imu.csv', rig_file='/nowhere/rig.yaml')

    def test_an_imu_without_its_rig(self):
        self.refuse(['~imu_file is given, but no ~rig_file'], name='/bad_rig',
                    nodelet_type='autocal_vio/SimulatedRigNodelet', imu_file=self.rig_file)

    def test_unknown_transport(self):
        self.refuse(['pigeon'], rig_file=self.rig_file, image_transport='pigeon')

    def test_nothing_to_hold(self):
        self.refuse(['fix_extrinsics'], rig_file=self.rig_file, fix_extrinsics=True)

    def describe_robot(self, camera_joint_type='fixed'):
        rospy.set_param('/robot_description', """<robot name="r"><link name="base"/><link name="imu"/><link name="cam"/>
            <joint name="imu_joint" type="fixed"><parent link="base"/><child link="imu"/></joint>
            <joint name="neck" type="%s"><parent link="base"/><child link="cam"/></joint></robot>""" % camera_joint_type)
        self.addCleanup(rospy.delete_param, '/robot_description')

    def test_extrinsics_from_a_robot_that_nobody_describes(self):
        self.refuse(['robot_description', '~imu_frame', '~camera_frame'], rig_file=self.rig_file, extrinsics_from_urdf=True)

    def test_extrinsics_over_a_joint_that_moves(self):
        self.describe_robot('continuous')
        self.refuse(['/robot_description: joint neck between imu and cam is continuous'], rig_file=self.rig_file,
                    extrinsics_from_urdf=True, imu_frame='imu', camera_frame='cam')

    def test_extrinsics_of_links_that_are_not_there(self):
        self.describe_robot()
        self.refuse(['no link imu9', 'no link cam9'], rig_file=self.rig_file, extrinsics_from_urdf=True, imu_frame='imu9',
                    camera_frame='cam9')

    def test_base_that_moves_on_the_imu(self):
        self.describe_robot('continuous')
        self.refuse(['joint neck between imu and cam is continuous'], rig_file=self.rig_file, imu_frame='imu',
                    base_frame='cam')

    def test_robot_description_that_is_none(self):
        rospy.set_param('/robot_description', '<robot name="r">')
        self.addCleanup(rospy.delete_param, '/robot_description')
        self.refuse(['/robot_description:1: is not valid XML'], rig_file=self.rig_file, extrinsics_from_urdf=True,
                    imu_frame='imu', camera_frame='cam', fix_extrinsics=True)

    def test_extrinsics_from_a_good_robot(self):
        self.describe_robot()
        self.log.clear()
        set_parameters('/from_urdf', rig_file=self.rig_file, extrinsics_from_urdf=True, imu_frame='imu', camera_frame='cam',
                       fix_extrinsics=True, base_frame='base')
        self.assertTrue(load_nodelet(MANAGER, '/from_urdf'))
        self.assertTrue(self.log.has('T_imu_cam (camera in the IMU frame): translation [0.00000'))
        self.assertTrue(self.log.has('T_cam_imu (its inverse, Kalibr'))
        self.assertTrue(unload_nodelet(MANAGER, '/from_urdf'))

    def test_unknown_parameters_are_reported(self):
        set_parameters('/misspelt', rig_file=self.rig_file, ques_size=5)
        self.assertTrue(load_nodelet(MANAGER, '/misspelt'))
        self.assertTrue(self.log.has('unknown parameter /misspelt/ques_size; did you mean ~queue_size?'))


if __name__ == '__main__':
    rospy.init_node('test_bad_parameters')
    rostest.rosrun('autocal_vio', 'test_bad_parameters', BadParameters)
