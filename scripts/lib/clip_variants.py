"""Other recordings made of one in EuRoC's ASL format: what is tuned to a single clip fails on them.

Each variant is a change of the same few things: stamps, IMU, images, camera, truth. The images stay real, with their blur and
noise, and so does the IMU with its vibration.
"""
import csv

import numpy as np
import yaml
from PIL import Image

MARGIN = 500000000  # [ns] of IMU and truth before the first image and after the last
DELAY = 30000000  # [ns]
TURN = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])  # a rotation
GYROSCOPE_BIAS, ACCELEROMETER_BIAS = [0.08, -0.1, 0.05], [0.2, -0.15, 0.1]  # [rad/s], [m/s^2]


class Recording:
    """stamps in ns; imu: stamp -> angular velocity, specific force; truth: stamp -> p_WB, R_WB; images: stamp -> file."""

    def __init__(self, folder):
        def rows(name):
            with open(folder / name) as stream:
                return [row for row in csv.reader(stream) if row and not row[0].startswith('#')]

        self.folder = folder
        self.images = [(int(row[0]), row[1].strip()) for row in rows('cam0/data.csv')]
        self.begin, self.end = self.images[0][0] - MARGIN, self.images[-1][0] + MARGIN
        self.imu = [(t, v[:3], v[3:6]) for t, v in self.within(rows('imu0/data.csv'))]
        self.truth = [(t, v[:3], rotation(v[3:7])) for t, v in self.within(rows('state_groundtruth_estimate0/data.csv'))]
        self.camera = yaml.safe_load((folder / 'cam0/sensor.yaml').read_text())
        self.sensor = yaml.safe_load((folder / 'imu0/sensor.yaml').read_text())
        self.T_BC = np.array(self.camera['T_BS']['data'], float).reshape(4, 4)
        self.change = lambda image, index: image

    def within(self, rows):
        return [(int(row[0]), np.array(row[1:], float)) for row in rows if self.begin <= int(row[0]) <= self.end]

    def write(self, folder):
        for name in ('cam0/data', 'imu0', 'state_groundtruth_estimate0'):
            (folder / name).mkdir(parents=True, exist_ok=True)
        write_rows(folder / 'imu0/data.csv', [(t, *w, *a) for t, w, a in self.imu])
        write_rows(folder / 'state_groundtruth_estimate0/data.csv', [(t, *p, *quaternion(R)) for t, p, R in self.truth])
        write_rows(folder / 'cam0/data.csv', [(t, '%d.png' % t) for t, _ in self.images])
        for index, (stamp, name) in enumerate(self.images):
            gray = np.array(Image.open(self.folder / 'cam0/data' / name), float)
            changed = np.clip(np.round(self.change(gray, index)), 0, 255).astype(np.uint8)
            Image.fromarray(changed).save(folder / 'cam0/data' / ('%d.png' % stamp), compress_level=1)
        self.camera['T_BS']['data'] = self.T_BC.ravel().tolist()
        (folder / 'cam0/sensor.yaml').write_text(yaml.safe_dump(self.camera))
        (folder / 'imu0/sensor.yaml').write_text(yaml.safe_dump(self.sensor))


def write_rows(path, rows):
    with open(path, 'w') as stream:
        stream.write('#stamp [ns]\n')
        for row in rows:
            stream.write(','.join(str(value) if isinstance(value, (int, str)) else '%.10g' % value for value in row) + '\n')


def rotation(q):
    w, x, y, z = q
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])


def quaternion(R):
    """w x y z, by the eigenvector of Bar-Itzhack's matrix: sound for every rotation."""
    K = np.array([[R[0, 0] - R[1, 1] - R[2, 2], R[1, 0] + R[0, 1], R[2, 0] + R[0, 2], R[2, 1] - R[1, 2]],
                  [R[1, 0] + R[0, 1], R[1, 1] - R[0, 0] - R[2, 2], R[2, 1] + R[1, 2], R[0, 2] - R[2, 0]],
                  [R[2, 0] + R[0, 2], R[2, 1] + R[1, 2], R[2, 2] - R[0, 0] - R[1, 1], R[1, 0] - R[0, 1]],
                  [R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], np.trace(R)]])
    x, y, z, w = np.linalg.eigh(K)[1][:, 3]
    return w, x, y, z


def backwards(r):
    """Velocities change their sign with time, accelerations do not."""
    r.imu = [(r.begin + r.end - t, -w, a) for t, w, a in reversed(r.imu)]
    r.truth = [(r.begin + r.end - t, p, R) for t, p, R in reversed(r.truth)]
    r.images = [(r.begin + r.end - t, name) for t, name in reversed(r.images)]


def mirrored(r):
    """The world in a mirror: y of world and body and x of the camera change their sign; angular velocity is a pseudovector."""
    S, C = np.diag([1.0, -1.0, 1.0]), np.diag([-1.0, 1.0, 1.0])
    r.imu = [(t, -S @ w, S @ a) for t, w, a in r.imu]
    r.truth = [(t, S @ p, S @ R @ S) for t, p, R in r.truth]
    r.T_BC[:3, :3], r.T_BC[:3, 3] = S @ r.T_BC[:3, :3] @ C, S @ r.T_BC[:3, 3]
    r.camera['intrinsics'][2] = r.camera['resolution'][0] - 1 - r.camera['intrinsics'][2]
    r.camera['distortion_coefficients'][3] *= -1
    r.change = lambda image, index: image[:, ::-1]


def mirrored_backwards(r):
    backwards(r)
    mirrored(r)


def images_10_hz(r):
    r.images, r.camera['rate_hz'] = r.images[::2], r.camera['rate_hz'] / 2


def imu_100_hz(r):
    pairs = zip(r.imu[::2], r.imu[1::2])
    r.imu = [((a[0] + b[0]) // 2, (a[1] + b[1]) / 2, (a[2] + b[2]) / 2) for a, b in pairs]
    r.sensor['rate_hz'] = r.sensor['rate_hz'] / 2


def half_size(r):
    fu, fv, pu, pv = r.camera['intrinsics']
    r.camera['intrinsics'] = [fu / 2, fv / 2, (pu + 0.5) / 2 - 0.5, (pv + 0.5) / 2 - 0.5]
    width, height = r.camera['resolution']
    r.camera['resolution'] = [width // 2, height // 2]
    r.change = lambda image, index: image.reshape(height // 2, 2, width // 2, 2).mean((1, 3))


def half_size_backwards(r):
    backwards(r)
    half_size(r)


def dark(r):
    r.change = lambda image, index: 0.3 * image


def flickering(r):
    r.change = lambda image, index: (1 + 0.35 * np.sin(index / 4)) * image


def exposure_steps(r):
    r.change = lambda image, index: (1.6 if index // 40 % 2 else 0.6) * image


def smeared(r):
    def smear(image, index):
        sums = np.cumsum(np.pad(image, ((0, 0), (5, 0)), mode='edge'), axis=1)
        return (sums[:, 5:] - sums[:, :-5]) / 5
    r.change = smear


def turned_and_biased(r):
    r.imu = [(t, TURN.T @ w + GYROSCOPE_BIAS, TURN.T @ a + ACCELEROMETER_BIAS) for t, w, a in r.imu]
    r.truth = [(t, p, R @ TURN) for t, p, R in r.truth]
    r.T_BC[:3] = TURN.T @ r.T_BC[:3]


def imu_late(r):
    r.imu = [(t + DELAY, w, a) for t, w, a in r.imu]
    r.truth = [(t + DELAY, p, R) for t, p, R in r.truth]


VARIANTS = (backwards, mirrored, mirrored_backwards, images_10_hz, imu_100_hz, half_size, half_size_backwards, dark,
            flickering, exposure_steps, smeared, turned_and_biased, imu_late)
