#!/usr/bin/python3
"""Watches a running VioNodelet: prints its progress once a second and records what it publishes.

Writes into OUT the files that calibrate_bag writes (odometry.tum, extrinsics.csv), the truth where it is published
(truth.tum, extrinsics_truth.yaml) and live.yaml with counts. Ends some seconds after the calibration has converged,
when the input has ended, or after the time limit. Exit 0: converged; 2: not converged; 1: nothing came.
"""
import argparse
import math
import pathlib
import sys
import threading
import time

import numpy as np
import rospy
import yaml
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from tf2_msgs.msg import TFMessage

from autocal_vio.msg import CalibrationStatus

import evaluation

DONE_STATES = (CalibrationStatus.CONVERGED, CalibrationStatus.FROZEN)


def vector(v):
    return [v.x, v.y, v.z]


def quaternion(q):
    return [q.x, q.y, q.z, q.w]


def matrix(pose):
    """4x4 rows of a pose, for YAML."""
    q = np.array(quaternion(pose.orientation))
    axes = [evaluation.multiply(evaluation.multiply(q, np.append(e, 0.0)), evaluation.inverse(q))[:3] for e in np.eye(3)]
    rows = np.column_stack(axes + [vector(pose.position)])
    return [[float(value) for value in row] for row in rows] + [[0.0, 0.0, 0.0, 1.0]]


def optical_sigmas(status):
    """Sigmas of the right perturbation of R_imu_cam [rad], from the message's rotation about the axes of the IMU."""
    covariance = np.array(status.T_imu_cam_covariance).reshape(6, 6)[3:, 3:]
    if not np.all(np.isfinite(covariance)):
        return np.full(3, math.inf)
    R = np.array(matrix(status.T_imu_cam))[:3, :3]
    return np.sqrt(np.maximum(np.diag(R.T @ covariance @ R), 0.0))


class Recorder:
    """What arrives, written as it comes. ROS callbacks run in threads of their own: every one takes the lock."""

    def __init__(self, out):
        self.out = out
        self.lock = threading.Lock()
        self.odometry = open(out / 'odometry.tum', 'w')
        self.extrinsics = open(out / 'extrinsics.csv', 'w')
        self.extrinsics.write('stamp_s,px,py,pz,qx,qy,qz,qw,sigma_px,sigma_py,sigma_pz,sigma_rx,sigma_ry,sigma_rz,'
                              'td,sigma_td,state\n')
        self.truth = None
        self.truth_extrinsics = None
        self.status = None
        self.first_image_s = None
        self.first_odometry_s = None
        self.converged_s = None
        self.last_arrival = time.monotonic()
        self.counts = {'status': 0, 'odometry': 0, 'odometry_imu': 0, 'tf': {}}
        self.latencies_ms = []

    def on_status(self, status):
        stamp = status.header.stamp.to_sec()
        values = vector(status.T_imu_cam.position) + quaternion(status.T_imu_cam.orientation)
        values += list(status.sigma_translation) + list(optical_sigmas(status))
        values += [status.time_offset, status.sigma_time_offset]
        with self.lock:
            self.status = status
            self.last_arrival = time.monotonic()
            self.counts['status'] += 1
            self.latencies_ms.append(status.latency_ms)
            if self.first_image_s is None:
                self.first_image_s = stamp
            if status.state in DONE_STATES and self.converged_s is None:
                self.converged_s = stamp
            self.extrinsics.write('%.9f,' % stamp + ','.join('%.9g' % v for v in values) + ',%s\n' % status.state)

    def on_odometry(self, odometry):
        with self.lock:
            self.counts['odometry'] += 1
            stamp = odometry.header.stamp.to_sec()
            if self.first_odometry_s is None:
                self.first_odometry_s = stamp
            self.write_pose(self.odometry, odometry)

    def on_odometry_imu(self, _):
        with self.lock:
            self.counts['odometry_imu'] += 1

    def on_truth(self, odometry):
        with self.lock:
            if self.truth is None:
                self.truth = open(self.out / 'truth.tum', 'w')
            self.write_pose(self.truth, odometry)

    def on_truth_extrinsics(self, message):
        with self.lock:
            self.truth_extrinsics = message.pose

    def on_tf(self, message):
        with self.lock:
            by_parent = self.counts['tf']
            for transform in message.transforms:
                parent = transform.header.frame_id
                by_parent[parent] = by_parent.get(parent, 0) + 1

    @staticmethod
    def write_pose(file, odometry):
        pose = odometry.pose.pose
        file.write('%.9f ' % odometry.header.stamp.to_sec())
        file.write(' '.join('%.9g' % v for v in vector(pose.position) + quaternion(pose.orientation)) + '\n')

    def progress(self):
        """One line on where things stand."""
        with self.lock:
            status, truth = self.status, self.truth_extrinsics
        if status is None:
            return 'waiting for the first image'
        elapsed = status.header.stamp.to_sec() - self.first_image_s
        rotation_sigma = math.degrees(max(status.sigma_rotation))
        translation_sigma = max(status.sigma_translation)
        line = '%5.1f s  %-23s' % (elapsed, status.state)
        if status.state in (CalibrationStatus.WAITING_FOR_DATA, CalibrationStatus.CALIBRATING_ROTATION):
            return line + '  ' + (status.motion_advice or status.reason)
        if truth is not None:
            p, q = np.array(vector(truth.position)), np.array(quaternion(truth.orientation))
            estimate = status.T_imu_cam
            turn = evaluation.log(evaluation.multiply(evaluation.inverse(q), np.array(quaternion(estimate.orientation))))
            line += '  rotation off by %.2f deg (sigma %.2f)' % (math.degrees(np.linalg.norm(turn)), rotation_sigma)
            if math.isfinite(translation_sigma):
                distance = np.linalg.norm(np.array(vector(estimate.position)) - p)
                line += '  translation by %.1f cm (sigma %.1f)' % (100 * distance, 100 * translation_sigma)
        else:
            line += '  rotation sigma %.2f deg' % rotation_sigma
            if math.isfinite(translation_sigma):
                line += '  translation [%.3f %.3f %.3f] m (sigma %.3f)' % (
                    *vector(status.T_imu_cam.position), translation_sigma)
        return line + ('  %s' % status.motion_advice if status.motion_advice else '')

    def close(self):
        with self.lock:
            for file in (self.odometry, self.extrinsics, self.truth):
                if file is not None:
                    file.close()
            if self.truth_extrinsics is not None:
                data = {'cam0': {'T_imu_cam': matrix(self.truth_extrinsics)}}
                (self.out / 'extrinsics_truth.yaml').write_text(yaml.safe_dump(data))
            live = dict(self.counts)
            if self.status is not None:
                live['images_processed'] = int(self.status.images_processed)
                live['images_dropped'] = int(self.status.images_dropped)
                live['final_state'] = self.status.state
                live['reason'] = self.status.reason
                live['latency_ms_median'] = float(np.median(self.latencies_ms))
                live['latency_ms_p99'] = float(np.percentile(self.latencies_ms, 99))
                live['first_odometry_after_s'] = self.after_first_image(self.first_odometry_s)
                live['converged_after_s'] = self.after_first_image(self.converged_s)
            (self.out / 'live.yaml').write_text(yaml.safe_dump(live))

    def after_first_image(self, stamp):
        return None if stamp is None else round(stamp - self.first_image_s, 3)


def parse():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--out', type=pathlib.Path, required=True)
    parser.add_argument('--namespace', default='/vio', help="the nodelet's private namespace")
    parser.add_argument('--truth', help='topic of the true odometry of the IMU')
    parser.add_argument('--truth-extrinsics', help='topic of the true T_imu_cam (PoseStamped)')
    parser.add_argument('--after-converged', type=float, default=15.0, help='goes on for this long [s]; <0: to the end')
    parser.add_argument('--silence', type=float, default=5.0, help='the input has ended after this long without any [s]')
    parser.add_argument('--limit', type=float, default=150.0, help='at most this long [s]')
    parser.add_argument('--quiet', action='store_true', help='no progress lines')
    return parser.parse_args(rospy.myargv(sys.argv)[1:])


def watch(recorder, arguments):
    """Until it is over; prints a line a second."""
    start = time.monotonic()
    while not rospy.is_shutdown() and time.monotonic() - start < arguments.limit:
        time.sleep(1.0)
        if not arguments.quiet:
            print(recorder.progress(), flush=True)
        with recorder.lock:
            converged_for = None if recorder.converged_s is None else (
                recorder.status.header.stamp.to_sec() - recorder.converged_s)
            silent_for = time.monotonic() - recorder.last_arrival
            begun = recorder.status is not None
        if begun and silent_for > arguments.silence:
            return
        if converged_for is not None and 0 <= arguments.after_converged <= converged_for:
            return


def main():
    arguments = parse()
    arguments.out.mkdir(parents=True, exist_ok=True)
    rospy.init_node('live_monitor', anonymous=True)
    recorder = Recorder(arguments.out)
    name = arguments.namespace
    rospy.Subscriber(name + '/calibration_status', CalibrationStatus, recorder.on_status, queue_size=500)
    rospy.Subscriber(name + '/odometry', Odometry, recorder.on_odometry, queue_size=500)
    rospy.Subscriber(name + '/odometry_imu', Odometry, recorder.on_odometry_imu, queue_size=500)
    rospy.Subscriber('/tf', TFMessage, recorder.on_tf, queue_size=500)
    if arguments.truth:
        rospy.Subscriber(arguments.truth, Odometry, recorder.on_truth, queue_size=2000)
    if arguments.truth_extrinsics:
        rospy.Subscriber(arguments.truth_extrinsics, PoseStamped, recorder.on_truth_extrinsics, queue_size=10)
    watch(recorder, arguments)
    rospy.signal_shutdown('done')
    recorder.close()
    if recorder.status is None:
        sys.exit(1)
    sys.exit(0 if recorder.status.state in DONE_STATES else 2)


main()
