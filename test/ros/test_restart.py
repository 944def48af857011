#!/usr/bin/python3
"""What ~save_calibration wrote is what another start of vio.launch begins with: the camchain, and the URDF."""
import os
import pathlib
import signal
import subprocess
import tempfile
import unittest

import numpy
import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from tf2_msgs.msg import TFMessage

from autocal_vio.msg import CalibrationStatus
from autocal_vio.srv import FreezeExtrinsics, SaveCalibration

from ros_test_support import Collector, unload_nodelet, wait_for

# Kalibr's imu.yaml: keys without a section.
IMU = """accelerometer_noise_density: 2.0e-3
accelerometer_random_walk: 3.0e-3
gyroscope_noise_density: 1.6968e-4
gyroscope_random_walk: 1.9393e-5
rostopic: /imu0
update_rate: 200.0
"""

ROBOT = """<robot name="rig">
  <link name="base_link"/><link name="imu0"/><link name="mast"/><link name="cam0"/>
  <joint name="imu_joint" type="fixed"><parent link="base_link"/><child link="imu0"/>
    <origin xyz="0.1 0 0.2" rpy="0 0 1.57"/></joint>
  <joint name="mast_joint" type="fixed"><parent link="base_link"/><child link="mast"/><origin xyz="0 0 1"/></joint>
  <joint name="camera_joint" type="fixed"><parent link="mast"/><child link="cam0"/><origin xyz="0 0 0"/></joint>
</robot>
"""


def pose_vector(status):
    p, q = status.T_imu_cam.position, status.T_imu_cam.orientation
    sign = 1.0 if q.w >= 0.0 else -1.0
    return numpy.array([p.x, p.y, p.z, sign * q.x, sign * q.y, sign * q.z, sign * q.w])


class Run:
    """A nodelet's status and odometry, from before it starts on."""

    def __init__(self, name):
        self.statuses = Collector('/%s/calibration_status' % name, CalibrationStatus)
        self.odometry = Collector('/%s/odometry' % name, Odometry)

    def wait_for_odometry(self, timeout=60.0):
        return self.odometry.wait(lambda m: True, timeout)

    def processed(self):
        return [s for s in self.statuses.messages() if s.images_processed > 0]

    def seconds_to_odometry(self):
        """From the first image that was processed, by the stamps."""
        first = self.processed()[0].header.stamp
        return (self.odometry.messages()[0].header.stamp - first).to_sec()


class Restart(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = pathlib.Path(folder.name)
        (cls.folder / 'imu.yaml').write_text(IMU)
        cls.first = Run('vio')
        settled = cls.first.statuses.wait(
            lambda s: s.state == 'converged' or max(s.sigma_translation) < 0.01, 90.0)
        assert settled, 'no estimate from nothing'
        rospy.set_param('/robot_description', ROBOT)
        freeze = rospy.ServiceProxy('/vio/freeze_extrinsics', FreezeExtrinsics)
        assert freeze(rotation=True, translation=True, time_offset=True).success
        assert wait_for(lambda: cls.first.statuses.last().state == 'frozen', 10.0)
        cls.saved = pose_vector(cls.first.statuses.last())
        save = rospy.ServiceProxy('/vio/save_calibration', SaveCalibration)
        answer = save(camchain_path=str(cls.folder / 'camchain.yaml'), urdf_path=str(cls.folder / 'robot.urdf'))
        assert answer.success, answer.message
        assert unload_nodelet('/vio_manager', '/vio')

    def start(self, name, **arguments):
        """vio.launch in a process of its own, as from a shell."""
        run = Run(name)
        command = ['roslaunch', 'autocal_vio', 'vio.launch', 'name:=' + name, 'manager:=%s_manager' % name]
        process = subprocess.Popen(command + ['%s:=%s' % item for item in arguments.items()], start_new_session=True)
        self.addCleanup(self.stop, process)
        return run

    @staticmethod
    def stop(process):
        process.send_signal(signal.SIGINT)
        try:
            process.wait(20.0)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)

    def check(self, run, tolerance):
        """It begins with what was saved, does not look for the rotation again, and its odometry comes sooner."""
        self.assertIsNotNone(run.wait_for_odometry(), 'no odometry: ' + (run.statuses.last() or CalibrationStatus()).reason)
        first = run.processed()[0]
        self.assertLess(numpy.abs(pose_vector(first) - self.saved).max(), tolerance)
        self.assertLess(max(first.sigma_rotation), 0.02)
        self.assertLess(max(first.sigma_translation), 0.02)
        self.assertEqual({s.state for s in run.processed()} & {'calibrating_rotation', 'lost'}, set())
        for status in run.processed():
            self.assertNotIn('WRONG', status.reason)
        print('odometry after %.2f s, from nothing after %.2f s' %
              (run.seconds_to_odometry(), self.first.seconds_to_odometry()))
        self.assertLess(run.seconds_to_odometry(), self.first.seconds_to_odometry())

    def test_camchain(self):
        run = self.start('second', rig_file=self.folder / 'camchain.yaml', imu_file=self.folder / 'imu.yaml')
        self.check(run, 1e-9)

    def test_camchain_held(self):
        run = self.start('held', rig_file=self.folder / 'camchain.yaml', imu_file=self.folder / 'imu.yaml',
                         fix_extrinsics='true')
        self.check(run, 1e-9)
        self.assertEqual(len({tuple(pose_vector(s)) for s in run.processed()}), 1)

    def test_urdf(self):
        rospy.set_param('/robot_description', (self.folder / 'robot.urdf').read_text())
        transforms = Collector('/tf', TFMessage)
        run = self.start('third', rig_file=rospy.get_param('/simulated_rig/rig_file'), extrinsics_from_urdf='true',
                         imu_frame='imu0', camera_frame='cam0', base_frame='base_link')
        self.check(run, 1e-6)
        self.assertEqual(run.odometry.last().child_frame_id, 'base_link')
        # odom -> base_link only; the rest of the robot is somebody else's.
        self.assertTrue(wait_for(lambda: self.parents(transforms, 'base_link') == {'odom'}, 10.0))
        self.assertEqual(self.parents(transforms, 'imu0'), set())
        self.assertTrue(wait_for(lambda: self.parents(transforms, 'cam0') == {'imu0'}, 10.0))

    def test_urdf_with_its_static_transforms(self):
        """As robot_state_publisher broadcasts them: the IMU and the camera have their parents."""
        rospy.set_param('/robot_description', (self.folder / 'robot.urdf').read_text())
        publisher = rospy.Publisher('/tf_static', TFMessage, queue_size=1, latch=True)
        publisher.publish(TFMessage([self.static('base_link', 'imu0'), self.static('mast', 'cam0')]))
        self.addCleanup(publisher.unregister)
        transforms = Collector('/tf', TFMessage)
        diagnostics = Collector('/diagnostics', DiagnosticArray)
        run = self.start('fourth', rig_file=self.folder / 'camchain.yaml', imu_file=self.folder / 'imu.yaml')
        self.assertIsNotNone(run.wait_for_odometry())
        for child, parent, advice in (('imu0', 'base_link', '~base_frame'), ('cam0', 'mast', '~extrinsics')):
            named = diagnostics.wait(lambda d: any(
                "frame '%s' has the parent '%s'" % (child, parent) in s.message and advice in s.message for s in d.status))
            self.assertIsNotNone(named, child)
            self.assertEqual(self.parents(transforms, child), set())

    @staticmethod
    def static(parent, child):
        transform = TransformStamped()
        transform.header.frame_id, transform.child_frame_id = parent, child
        transform.transform.rotation.w = 1.0
        return transform

    @staticmethod
    def parents(transforms, child):
        return {t.header.frame_id for m in transforms.messages() for t in m.transforms if t.child_frame_id == child}


if __name__ == '__main__':
    rospy.init_node('test_restart')
    rostest.rosrun('autocal_vio', 'test_restart', Restart)
