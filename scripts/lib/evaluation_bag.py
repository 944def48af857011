"""Reads odometry, extrinsics and truth from a recorded bag, by topic."""
import math

import numpy as np
import rosbag

from evaluation import Extrinsics, Poses, rotation_matrix
from evaluation_files import BadFile

ODOMETRY = 'nav_msgs/Odometry'
STATUS = 'autocal_vio/CalibrationStatus'
POSE = 'geometry_msgs/PoseWithCovarianceStamped'
TF = 'tf2_msgs/TFMessage'
TRUTHS = (ODOMETRY, 'geometry_msgs/PoseStamped', 'geometry_msgs/TransformStamped', POSE)
NOBODY_TOLD = [math.nan]


def vector(v):
    return [v.x, v.y, v.z]


def quaternion(q):
    return [q.x, q.y, q.z, q.w]


def sigmas(covariance, q):
    """Of position (IMU axes) and rotation (camera axes) from a 6x6 covariance, whose rotation is about the IMU's axes."""
    matrix = np.array(covariance).reshape(6, 6)
    R = rotation_matrix(q)
    variance = np.concatenate([np.diag(matrix)[:3], np.diag(R.T @ matrix[3:, 3:] @ R)])
    return list(np.sqrt(np.maximum(variance, 0.0)))


class Recording:
    """A bag, opened. Every method throws BadFile with what is in the bag where it lacks what is asked for."""

    def __init__(self, path):
        self.path = path
        try:
            self.bag = rosbag.Bag(str(path))
        except rosbag.ROSBagUnindexedException as error:
            raise BadFile(path, None, 'the bag was not closed properly; mend it with: rosbag reindex') from error
        except (OSError, rosbag.ROSBagException) as error:
            raise BadFile(path, None, 'cannot be read as a bag: %s' % error) from error
        self.types = {topic: info.msg_type for topic, info in self.bag.get_type_and_topic_info().topics.items()}

    def close(self):
        self.bag.close()

    def topics_of(self, *types):
        return sorted(topic for topic, kind in self.types.items() if kind in types)

    def described(self):
        return ', '.join('%s (%s)' % entry for entry in sorted(self.types.items())) or 'none'

    def choose(self, wanted, types, option, preferred=None):
        """The topic wanted, or the only one of these types (several: those that end like `preferred` first)."""
        if wanted is not None:
            if wanted not in self.types:
                raise BadFile(self.path, None, 'has no topic %s; its topics: %s' % (wanted, self.described()))
            if self.types[wanted] not in types:
                raise BadFile(self.path, None, 'topic %s is %s, expected %s' %
                              (wanted, self.types[wanted], ' or '.join(types)))
            return wanted
        found = self.topics_of(*types)
        named = [topic for topic in found if preferred and topic.endswith(preferred)]
        for candidates in (named, found):
            if len(candidates) == 1:
                return candidates[0]
        if found:
            raise BadFile(self.path, None, 'has several topics to choose from; give %s: %s' % (option, ', '.join(found)))
        raise BadFile(self.path, None, 'has no topic of type %s; its topics: %s' % (' or '.join(types), self.described()))

    def odometry(self, wanted=None):
        """(Poses, name of the frame whose poses they are)"""
        topic = self.choose(wanted, (ODOMETRY,), '--odometry-topic', '/odometry')
        poses, frame = [], ''
        for _, message, _ in self.bag.read_messages(topics=[topic]):
            pose, frame = message.pose.pose, message.child_frame_id
            poses.append((message.header.stamp.to_sec(), vector(pose.position), quaternion(pose.orientation)))
        return (Poses(*zip(*poses)) if poses else Poses([], [], [])), frame

    def truth(self, wanted):
        """(Poses, name of the frame whose poses they are; empty where the messages do not say)"""
        topic = self.choose(wanted, TRUTHS, '--truth-topic')
        poses, frame = [], ''
        for _, message, _ in self.bag.read_messages(topics=[topic]):
            stamp = message.header.stamp.to_sec()
            frame = getattr(message, 'child_frame_id', '')
            if hasattr(message, 'transform'):
                poses.append((stamp, vector(message.transform.translation), quaternion(message.transform.rotation)))
                continue
            pose = message.pose.pose if hasattr(message.pose, 'pose') else message.pose
            poses.append((stamp, vector(pose.position), quaternion(pose.orientation)))
        return (Poses(*zip(*poses)) if poses else Poses([], [], [])), frame

    def extrinsics(self, wanted=None, imu_frame='', camera_frame=None):
        """evaluation.Extrinsics from a topic (status or pose) or, where there is none, from tf; None where tf lacks it, too."""
        if wanted is None and camera_frame is None:
            found = self.topics_of(STATUS) or [t for t in self.topics_of(POSE) if t.endswith('/extrinsics')]
            if len(found) > 1:
                raise BadFile(self.path, None, 'has several topics to choose from; give --extrinsics-topic: %s' %
                              ', '.join(found))
            wanted = found[0] if found else None
        if wanted is not None:
            topic = self.choose(wanted, (STATUS, POSE), '--extrinsics-topic')
            return self.from_status(topic) if self.types[topic] == STATUS else self.from_poses(topic)
        return self.from_tf(imu_frame, camera_frame)

    def from_status(self, topic):
        rows, states = {}, {}
        for _, message, _ in self.bag.read_messages(topics=[topic]):
            if message.sigma_rotation[0] >= 1000.0 and message.state in ('waiting_for_data', 'calibrating_rotation'):
                continue  # nothing is estimated yet
            stamp, q = message.header.stamp.to_sec(), quaternion(message.T_imu_cam.orientation)
            rows[stamp] = ([stamp] + vector(message.T_imu_cam.position) + q +
                           sigmas(message.T_imu_cam_covariance, q) + [message.time_offset, message.sigma_time_offset])
            states[stamp] = message.state
        return Extrinsics([rows[stamp] for stamp in sorted(rows)], [states[stamp] for stamp in sorted(rows)])

    def from_poses(self, topic):
        rows = []
        for _, message, _ in self.bag.read_messages(topics=[topic]):
            q = quaternion(message.pose.pose.orientation)
            rows.append([message.header.stamp.to_sec()] + vector(message.pose.pose.position) + q +
                        sigmas(message.pose.covariance, q) + 2 * NOBODY_TOLD)
        return Extrinsics(rows, [''] * len(rows))

    def from_tf(self, imu_frame, camera_frame):
        """From the broadcasts imu_frame -> camera_frame (None: the only child of the IMU that moves). Where the odometry is
        that of another frame than the IMU's, the camera's parent is taken for the IMU."""
        rows, others = {}, {}
        topics = self.topics_of(TF)  # none would stand for all
        for _, message, _ in self.bag.read_messages(topics=topics) if topics else ():
            for transform in message.transforms:
                parent, child = (name.lstrip('/') for name in (transform.header.frame_id, transform.child_frame_id))
                if camera_frame not in (None, child):
                    continue
                of_imu = parent == imu_frame.lstrip('/')
                if of_imu or camera_frame is not None:
                    (rows if of_imu else others).setdefault(child if of_imu else parent, []).append(
                        [transform.header.stamp.to_sec()] + vector(transform.transform.translation) +
                        quaternion(transform.transform.rotation) + 8 * NOBODY_TOLD)
        if not rows and len(others) == 1:
            rows = others
        if camera_frame is not None and not rows:
            raise BadFile(self.path, None, 'tf has no transform from %s to %s' % (imu_frame or '?', camera_frame))
        if len(rows) > 1:
            raise BadFile(self.path, None, 'tf has several frames on %s; give --camera-frame: %s' %
                          (imu_frame, ', '.join(sorted(rows))))
        chosen = sorted(next(iter(rows.values()))) if rows else []
        return Extrinsics(chosen, [''] * len(chosen)) if chosen else None
