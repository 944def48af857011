"""What the rostests share: a sensor that publishes, a listener with a deadline, loading of nodelets."""
import struct
import threading
import time

import rospy
from nodelet.srv import NodeletLoad, NodeletLoadRequest, NodeletUnload, NodeletUnloadRequest
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import Image, Imu

WIDTH, HEIGHT = 752, 480
IMAGE_TOPIC, IMU_TOPIC = '/cam0/image_raw', '/imu0'
REMAPPINGS = {'image': IMAGE_TOPIC, 'imu': IMU_TOPIC, 'camera_info': '/cam0/camera_info'}


def wait_for(condition, timeout):
    """The first true value of condition(), or its last value after `timeout` seconds."""
    end = time.monotonic() + timeout
    value = condition()
    while not value and time.monotonic() < end and not rospy.is_shutdown():
        time.sleep(0.02)
        value = condition()
    return value


class Collector:
    """Keeps the messages of one topic, with their times of arrival."""

    def __init__(self, topic, message_type, queue_size=1000):
        self.lock = threading.Lock()
        self.arrivals = []
        self.subscriber = rospy.Subscriber(topic, message_type, self.receive, queue_size=queue_size, tcp_nodelay=True)

    def receive(self, message):
        with self.lock:
            self.arrivals.append((time.monotonic(), message))

    def messages(self):
        with self.lock:
            return [message for _, message in self.arrivals]

    def last(self):
        with self.lock:
            return self.arrivals[-1][1] if self.arrivals else None

    def clear(self):
        with self.lock:
            self.arrivals = []

    def wait(self, condition, timeout=10.0):
        """The first message that fulfils the condition; None when none did in time."""
        return wait_for(lambda: next((m for m in self.messages() if condition(m)), None), timeout)

    def close(self):
        self.subscriber.unregister()


class RosoutCollector(Collector):
    """What the nodelets log."""

    def __init__(self):
        super().__init__('/rosout', Log)

    def has(self, text, timeout=10.0):
        return self.wait(lambda log: text in log.msg, timeout) is not None

    def count(self, text):
        return sum(1 for log in self.messages() if text in log.msg)


def image_message(stamp, width=WIDTH, height=HEIGHT, encoding='mono8'):
    """A picture with some texture."""
    image = Image()
    image.header.stamp = stamp
    image.header.frame_id = 'cam0'
    image.width, image.height, image.step, image.encoding = width, height, width, encoding
    row = bytes((7 * x * x // 5) % 256 for x in range(width))
    image.data = b''.join(row[y:] + row[:y] for y in range(height))
    return image


def imu_message(stamp):
    """A sample at rest."""
    imu = Imu()
    imu.header.stamp = stamp
    imu.header.frame_id = 'imu0'
    imu.orientation_covariance[0] = -1.0
    imu.angular_velocity.x = 1e-4 * struct.unpack('b', struct.pack('B', stamp.nsecs % 256))[0]
    imu.linear_acceleration.z = 9.81
    return imu


class Sensors(threading.Thread):
    """A camera (4 Hz) and an IMU (100 Hz) at rest. Each can be switched off; `shift` moves the stamps, `imu_shift`
    those of the IMU besides [s]."""

    def __init__(self, images=True, imu=True):
        super().__init__(daemon=True)
        self.images, self.imu, self.shift, self.imu_shift = images, imu, 0.0, 0.0
        self.image_publisher = rospy.Publisher(IMAGE_TOPIC, Image, queue_size=20)
        self.imu_publisher = rospy.Publisher(IMU_TOPIC, Imu, queue_size=500)
        self.template = image_message(rospy.Time(1))
        self.image_stamps = []
        self.running = True
        self.start()

    def run(self):
        try:
            self.publish_all()
        except rospy.ROSException:
            pass  # the test has ended

    def publish_all(self):
        tick = 0
        next_time = time.monotonic()
        while self.running and not rospy.is_shutdown():
            stamp = rospy.Time.now() + rospy.Duration(self.shift)
            if self.imu:
                self.imu_publisher.publish(imu_message(stamp + rospy.Duration(self.imu_shift)))
            if self.images and tick % 25 == 0:
                self.template.header.stamp = stamp
                self.image_publisher.publish(self.template)
                self.image_stamps.append(stamp.to_nsec())
            tick += 1
            next_time += 0.01
            time.sleep(max(0.0, next_time - time.monotonic()))

    def stop(self):
        self.running = False
        self.join()


def set_parameters(name, **parameters):
    """Replaces all private parameters of a nodelet."""
    if rospy.has_param(name):
        rospy.delete_param(name)
    for key, value in parameters.items():
        rospy.set_param(name + '/' + key, value)


def load_nodelet(manager, name, nodelet_type='autocal_vio/VioNodelet', remappings=None):
    """True when the manager has loaded it."""
    service = manager + '/load_nodelet'
    rospy.wait_for_service(service, 20.0)
    request = NodeletLoadRequest(name=name, type=nodelet_type)
    for source, target in (REMAPPINGS if remappings is None else remappings).items():
        request.remap_source_args.append(source)
        request.remap_target_args.append(target)
    try:
        return rospy.ServiceProxy(service, NodeletLoad)(request).success
    except rospy.ServiceException:
        return False


def unload_nodelet(manager, name):
    service = rospy.ServiceProxy(manager + '/unload_nodelet', NodeletUnload)
    return service(NodeletUnloadRequest(name=name)).success


def nodelets_of(manager):
    from nodelet.srv import NodeletList
    return rospy.ServiceProxy(manager + '/list', NodeletList)().nodelets
