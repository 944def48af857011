#!/usr/bin/python3
"""What camera and IMU drivers differ in: encodings, rates, names of topics."""
import subprocess
import time
import unittest

import numpy
import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import Image

from autocal_vio.msg import CalibrationStatus

from ros_test_support import HEIGHT, WIDTH, Collector, RosoutCollector, Sensors, image_message, load_nodelet, set_parameters
from ros_test_support import unload_nodelet

MANAGER = '/manager'
SIMULATED = {'cam0/image_raw': '/sim/image', 'cam0/camera_info': '/sim/camera_info', 'imu0': '/sim/imu'}


def grey_picture():
    """Blocks of random brightness: corners everywhere."""
    blocks = numpy.random.default_rng(1).integers(20, 236, (HEIGHT // 16, WIDTH // 16))
    return numpy.kron(blocks, numpy.ones((16, 16))).astype(numpy.uint8)


def encoded(encoding, grey):
    """The grey picture as a message of the encoding."""
    message = image_message(rospy.Time(1), encoding=encoding)
    pixels = grey
    if encoding == 'mono16':
        pixels = grey.astype(numpy.uint16) * 257
    elif encoding in ('bgr8', 'rgb8'):
        pixels = numpy.repeat(grey[:, :, None], 3, axis=2)
    message.step = WIDTH * pixels.itemsize * (3 if pixels.ndim == 3 else 1)
    message.data = pixels.tobytes()
    return message


class Drivers(unittest.TestCase):
    def setUp(self):
        self.rig_file = rospy.get_param('/rig_file')

    def load(self, name, remappings=None, **parameters):
        set_parameters(name, rig_file=self.rig_file, **parameters)
        self.assertTrue(load_nodelet(MANAGER, name, remappings=remappings))
        self.addCleanup(unload_nodelet, MANAGER, name)
        return Collector(name + '/calibration_status', CalibrationStatus)

    def simulate(self, **parameters):
        set_parameters('/rig', rig_file=self.rig_file, **parameters)
        self.assertTrue(load_nodelet(MANAGER, '/rig', 'autocal_vio/SimulatedRigNodelet', SIMULATED))
        self.addCleanup(unload_nodelet, MANAGER, '/rig')

    def test_encodings(self):
        statuses = self.load('/encodings')
        pictures = Collector('/encodings/tracks', Image)
        sensors = Sensors(images=False)
        self.addCleanup(sensors.stop)
        # An image older than all IMU samples is dropped: these have to flow first.
        self.assertIsNotNone(statuses.wait(lambda s: 'no image on' in s.reason and 'no IMU' not in s.reason))
        grey = grey_picture()
        for encoding in ('mono8', 'mono16', 'bgr8', 'rgb8', 'bayer_rggb8', 'bayer_bggr8', 'bayer_gbrg8', 'bayer_grbg8'):
            sensors.images = False
            sensors.template = encoded(encoding, grey)
            sensors.images = True
            rospy.sleep(0.3)
            statuses.clear()
            pictures.clear()
            self.assertIsNotNone(statuses.wait(lambda s: s.tracked_features > 80), 'no tracks in ' + encoding)
            self.assertEqual(statuses.last().images_dropped, 0, encoding)
            picture = pictures.wait(lambda p: True)
            shown = numpy.frombuffer(picture.data, numpy.uint8).reshape(HEIGHT, WIDTH, 3)
            # Under the tracks, within blocks (colours of a bayer pattern mix at their edges), it is the picture.
            difference = numpy.abs(numpy.median(shown.astype(float), axis=2) - grey)[8::16, 8::16]
            self.assertLess(numpy.median(difference), 2.0, encoding)

    def test_slow_camera_and_fast_imu(self):
        statuses = self.load('/slow', {'image': '/sim/image', 'imu': '/sim/imu'})
        self.simulate(image_rate=10, imu_rate=1000, duration=20, start_delay=1)
        self.assertIsNotNone(statuses.wait(lambda s: s.images_processed > 25))
        processed = [s.header.stamp.to_sec() for s in statuses.messages() if s.images_processed > 0]
        self.assertAlmostEqual(numpy.median(numpy.diff(processed)), 0.1, places=3)
        self.assertEqual(statuses.last().imu_dropped, 0)
        self.assertEqual(statuses.last().images_dropped, 0)

    def test_fast_camera(self):
        statuses = self.load('/fast', {'image': '/sim/image', 'imu': '/sim/imu'})
        self.simulate(image_rate=60, duration=20, start_delay=1)
        self.assertIsNotNone(statuses.wait(lambda s: s.images_processed > 60))
        processed = [s.header.stamp.to_sec() for s in statuses.messages() if s.images_processed > 0]
        self.assertAlmostEqual(numpy.median(numpy.diff(processed)), 1.0 / 30.0, places=3)
        self.assertEqual(statuses.last().images_dropped, 0)

    def test_clocks_of_another_epoch(self):
        sensors = Sensors()
        self.addCleanup(sensors.stop)
        sensors.imu_shift = -3600.0
        statuses = self.load('/epochs')
        self.assertIsNotNone(statuses.wait(lambda s: 's ahead of /imu0: the clocks disagree' in s.reason))
        statuses.clear()
        rospy.sleep(3.0)
        told = statuses.messages()
        self.assertGreater(len(told), 8)  # each of the 12 images has its status
        self.assertTrue(all('the clocks disagree' in s.reason for s in told))

    def test_clocks_a_little_apart(self):
        sensors = Sensors()
        self.addCleanup(sensors.stop)
        sensors.imu_shift = 0.7
        statuses = self.load('/apart')
        self.assertIsNotNone(statuses.wait(lambda s: 's behind /imu0: the clocks disagree' in s.reason))
        sensors.imu_shift = 0.0
        statuses.clear()
        self.assertIsNotNone(statuses.wait(lambda s: s.images_processed > 0 and 'clocks' not in s.reason))

    def test_two_publishers_on_one_topic(self):
        sensors = Sensors()
        self.addCleanup(sensors.stop)
        log = RosoutCollector()
        self.load('/crowded')
        # Two publishers of one node count as one: this one is another node's.
        talker = subprocess.Popen(['rostopic', 'pub', '-r', '1', '/imu0', 'sensor_msgs/Imu', '{}'])
        self.addCleanup(talker.wait)
        self.addCleanup(talker.terminate)
        self.assertTrue(log.has('2 nodes publish /imu0'))

    def test_misspelt_topics(self):
        sensors = Sensors()
        self.addCleanup(sensors.stop)
        diagnostics = Collector('/diagnostics', DiagnosticArray)
        begin = time.monotonic()
        statuses = self.load('/misspelt', {'image': '/cam0/image', 'imu': '/imu'})
        named = statuses.wait(lambda s: '/cam0/image ' in s.reason and '/imu ' in s.reason, 5.0)
        self.assertIsNotNone(named, 'the topics are not named in the status')
        self.assertIn('nobody publishes it; messages of its type are on /cam0/image_raw', named.reason)
        self.assertIn('nobody publishes it; messages of its type are on /imu0', named.reason)
        self.assertEqual(named.state, 'waiting_for_data')
        in_diagnostics = diagnostics.wait(lambda d: any(s.level == 2 and '/cam0/image ' in s.message for s in d.status), 5.0)
        self.assertIsNotNone(in_diagnostics, 'the topics are not named in the diagnostics')
        for collector in (statuses, diagnostics):
            arrival = next(when for when, message in collector.arrivals
                           if message is named or message is in_diagnostics)
            self.assertLess(arrival - begin, 3.0)  # two seconds after loading, which itself takes a while


if __name__ == '__main__':
    rospy.init_node('test_drivers')
    rostest.rosrun('autocal_vio', 'test_drivers', Drivers)
