#!/usr/bin/python3
"""The simulated rig and the nodelet in one manager, live: rates, frames, stamps, covariances, tf."""
import math
import unittest

import numpy
import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, TransformStamped, Vector3Stamped
from nav_msgs.msg import Odometry, Path
from sensor_msgs.msg import CameraInfo, Image, Imu, PointCloud2
from tf2_msgs.msg import TFMessage

from autocal_vio.msg import CalibrationStatus
from autocal_vio.srv import BumpMount

from ros_test_support import Collector, RosoutCollector, wait_for


def stamps(messages):
    return [m.header.stamp.to_nsec() for m in messages]


def transforms(collector, child):
    return [t for m in collector.messages() for t in m.transforms if t.child_frame_id == child]


def broadcast_static(parent, child):
    """As another node would; the publisher."""
    transform = TransformStamped()
    transform.header.frame_id, transform.child_frame_id = parent, child
    transform.transform.rotation.w = 1.0
    publisher = rospy.Publisher('/tf_static', TFMessage, queue_size=1, latch=True)
    publisher.publish(TFMessage([transform]))
    return publisher


class LiveSimulation(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        topics = {'truth': ('/simulated_rig/truth', Odometry), 'info': ('/cam0/camera_info', CameraInfo),
                  'imu': ('/imu0', Imu), 'truth_extrinsics': ('/simulated_rig/truth_extrinsics', PoseStamped),
                  'truth_gyroscope_bias': ('/simulated_rig/truth_gyroscope_bias', Vector3Stamped),
                  'truth_accelerometer_bias': ('/simulated_rig/truth_accelerometer_bias', Vector3Stamped),
                  'status': ('/vio/calibration_status', CalibrationStatus), 'odometry': ('/vio/odometry', Odometry),
                  'odometry_imu': ('/vio/odometry_imu', Odometry), 'path': ('/vio/path', Path),
                  'landmarks': ('/vio/landmarks', PointCloud2), 'tracks': ('/vio/tracks', Image),
                  'diagnostics': ('/diagnostics', DiagnosticArray), 'tf': ('/tf', TFMessage),
                  'extrinsics': ('/vio/extrinsics', PoseWithCovarianceStamped)}
        cls.all = {name: Collector(*topic) for name, topic in topics.items()}
        cls.started = cls.all['odometry'].wait(lambda m: True, 45.0)

        def caught_up():  # what the first solution has held up has been processed
            images, samples = (len(cls.all[name].messages()) for name in ('odometry', 'odometry_imu'))
            return images > 60 and samples > 6 * images

        wait_for(caught_up, 40.0)

    def messages(self, name):
        return self.all[name].messages()

    def assert_covariance(self, values):
        matrix = numpy.array(values).reshape(6, 6)
        self.assertTrue(numpy.all(numpy.isfinite(matrix)))
        self.assertLess(numpy.abs(matrix - matrix.T).max(), 1e-9 * numpy.abs(matrix).max())
        self.assertGreater(numpy.linalg.eigvalsh(matrix).min(), 0.0)

    def test_1_the_rig_publishes_at_its_rates(self):
        images, imu = stamps(self.messages('info')), stamps(self.messages('imu'))
        self.assertEqual(images, sorted(set(images)))
        self.assertEqual(imu, sorted(set(imu)))
        self.assertAlmostEqual(numpy.median(numpy.diff(images)) * 1e-9, 0.05, places=3)
        self.assertAlmostEqual(numpy.median(numpy.diff(imu)) * 1e-9, 0.005, places=4)
        self.assertLess(abs(imu[-1] - images[-1]) * 1e-9, 0.5)
        self.assertEqual(len(self.messages('truth_extrinsics')), 1)

    def test_1_the_rig_tells_its_biases(self):
        images = set(stamps(self.messages('info')))
        for name, field in (('truth_gyroscope_bias', 'gyroscope_bias'), ('truth_accelerometer_bias', 'accelerometer_bias')):
            told = self.messages(name)
            self.assertTrue(all(stamp in images for stamp in stamps(told)[:-5]))
            truth = numpy.array([[m.vector.x, m.vector.y, m.vector.z] for m in told])
            self.assertGreater(numpy.linalg.norm(truth[-1]), 0.01)
            status = self.messages('status')[-1]
            found, sigma = getattr(status, field), getattr(status, 'sigma_' + field)
            for k, axis in enumerate('xyz'):
                error = abs(getattr(found, axis) - truth[-1, k])
                self.assertLess(error, 5.0 * getattr(sigma, axis) + 1e-3, name + ' ' + axis)

    def test_2_every_image_has_a_status(self):
        # An image that waits for the IMU has a status at once and another one as its result: then the count has grown.
        results = []
        for status in self.messages('status'):
            if status.images_processed > (results[-1].images_processed if results else 0):
                results.append(status)
        last, reported = results[-1], {s.header.stamp.to_nsec() for s in results}
        # From the first image that reached the nodelet on; on a busy machine some are dropped, and counted.
        images = [s for s in stamps(self.messages('truth')) if min(reported) <= s <= max(reported)]
        print('%d images, %d processed, %d dropped' % (len(images), last.images_processed, last.images_dropped))
        self.assertGreaterEqual(last.images_processed + last.images_dropped, len(images))
        self.assertGreater(len(reported), 0.9 * last.images_processed)
        self.assertGreater(len(reported), 50)
        self.assertEqual(last.header.frame_id, 'imu0')
        self.assertEqual(last.imu_dropped, 0)

    def test_3_odometry(self):
        self.assertIsNotNone(self.started, 'no odometry within 45 s')
        odometry = self.messages('odometry')
        self.assertGreater(len(odometry), 20)
        images = set(stamps(self.messages('info')))
        self.assertTrue(all(stamp in images for stamp in stamps(odometry)[:-5]))
        self.assertAlmostEqual(numpy.median(numpy.diff(stamps(odometry))) * 1e-9, 0.05, places=3)
        for message in odometry[::5]:
            self.assertEqual(message.header.frame_id, 'odom')
            self.assertEqual(message.child_frame_id, 'imu0')
            self.assert_covariance(message.pose.covariance)
            self.assert_covariance(message.twist.covariance)

    def test_4_twist_is_that_of_the_imu(self):
        truth = {m.header.stamp.to_nsec(): m.twist.twist for m in self.messages('truth')}
        errors = []
        for message in self.messages('odometry')[20:]:
            true = truth.get(message.header.stamp.to_nsec())
            if true is not None:
                twist = message.twist.twist
                errors.append([getattr(twist.linear, k) - getattr(true.linear, k) for k in 'xyz'] +
                              [getattr(twist.angular, k) - getattr(true.angular, k) for k in 'xyz'])
        self.assertGreater(len(errors), 10)
        median = numpy.median(numpy.abs(errors), axis=0)
        self.assertLess(median[:3].max(), 0.2)
        self.assertLess(median[3:].max(), 0.05)

    def test_5_odometry_at_imu_rate(self):
        samples = set(stamps(self.messages('imu')))
        carried = self.messages('odometry_imu')
        self.assertGreater(len(carried), 5 * len(self.messages('odometry')))
        newest = max(samples)  # the two topics need not have arrived here up to the same sample
        self.assertTrue(all(stamp in samples for stamp in stamps(carried) if stamp <= newest))
        self.assertEqual(stamps(carried), sorted(set(stamps(carried))))
        self.assertEqual(carried[-1].child_frame_id, 'imu0')
        self.assert_covariance(carried[-1].pose.covariance)
        self.assert_covariance(carried[-1].twist.covariance)

    def test_6_pictures_and_extrinsics(self):
        for name in ('path', 'landmarks', 'tracks', 'extrinsics'):
            self.assertGreater(len(self.messages(name)), 0, name)
        self.assertEqual(self.messages('path')[-1].header.frame_id, 'odom')
        self.assertGreater(len(self.messages('path')[-1].poses), 5)
        self.assertEqual(self.messages('landmarks')[-1].header.frame_id, 'odom')
        self.assertEqual(self.messages('tracks')[-1].encoding, 'bgr8')
        extrinsics = self.messages('extrinsics')[-1]
        self.assertEqual(extrinsics.header.frame_id, 'imu0')
        self.assert_covariance(extrinsics.pose.covariance)

    def test_7_tf(self):
        images = set(stamps(self.messages('info')))
        for parent, child in (('odom', 'imu0'), ('imu0', 'cam0')):
            found = transforms(self.all['tf'], child)
            self.assertGreater(len(found), 10, child)
            self.assertEqual({t.header.frame_id for t in found}, {parent})
            self.assertTrue(all(t.header.stamp.to_nsec() in images for t in found[:-5]))

    def test_8_no_frame_gets_a_second_parent(self):
        log = RosoutCollector()
        others = broadcast_static('mast', 'cam0')
        self.addCleanup(others.unregister)
        rospy.sleep(2.0)
        self.all['tf'].clear()
        self.assertTrue(wait_for(lambda: len(transforms(self.all['tf'], 'imu0')) > 10, 5.0))
        self.assertEqual(transforms(self.all['tf'], 'cam0'), [])
        self.assertTrue(log.has("frame 'cam0' has the parent 'mast' already"))
        self.assertEqual(log.count("not broadcasting 'imu0' -> 'cam0'"), 1)
        warned = self.all['diagnostics'].wait(
            lambda d: any(s.name.endswith('outputs') and s.level == 1 and "the parent 'mast'" in s.message for s in d.status))
        self.assertIsNotNone(warned, 'the diagnostics do not name the conflict')

    def test_8_no_loop_of_frames(self):
        log = RosoutCollector()
        others = broadcast_static('imu0', 'odom')
        self.addCleanup(others.unregister)
        self.assertTrue(log.has("frame 'imu0' is above 'odom' already: a loop; not broadcasting 'odom' -> 'imu0'"))
        self.all['tf'].clear()
        rospy.sleep(1.0)
        self.assertEqual(transforms(self.all['tf'], 'imu0'), [])

    def test_9_bump(self):
        bump = rospy.ServiceProxy('/simulated_rig/bump', BumpMount)
        before = self.all['truth_extrinsics'].last().pose
        request = BumpMount._request_class()
        request.translation.x = 0.05
        self.assertTrue(bump(request).success)
        after = self.all['truth_extrinsics'].wait(lambda m: m.pose != before)
        self.assertIsNotNone(after)
        moved = [getattr(after.pose.position, k) - getattr(before.position, k) for k in 'xyz']
        self.assertAlmostEqual(math.sqrt(sum(d * d for d in moved)), 0.05, places=9)
        told = self.all['status'].wait(lambda m: 'the camera has moved on its mount' in m.reason)
        self.assertIsNotNone(told, 'the status does not say so')


if __name__ == '__main__':
    rospy.init_node('test_live_simulation')
    rostest.rosrun('autocal_vio', 'test_live_simulation', LiveSimulation)
