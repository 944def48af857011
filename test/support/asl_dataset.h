// A tiny data set in ASL format for tests.
#pragma once

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>

#include "temporary_folder.h"

namespace autocal_vio {

constexpr long long kAslBegin = 1000000000000000000LL;  // stamp of the first image [ns]

/// Writes `images` grey images at 20 Hz and IMU samples at 200 Hz from 2 s before the first image to 2 s
/// after the last, under `name`/mav0. The rig stands still: gravity along +y of the IMU, texture that does
/// not move.
inline std::string writeAslDataset(const TemporaryFolder& folder, const std::string& name, int images) {
  const std::string mav0 = name + "/mav0";
  std::string image_table = "#timestamp [ns],filename\r\n", imu_table = "#timestamp [ns],w,w,w,a,a,a\n";
  cv::Mat picture(480, 752, CV_8UC1);
  cv::RNG(7).fill(picture, cv::RNG::UNIFORM, 0, 255);
  for (int i = 0; i < images; ++i) {
    const std::string stamp = std::to_string(kAslBegin + i * 50000000LL);
    image_table += stamp + "," + stamp + ".png\r\n";
    const std::string file = folder.write(mav0 + "/cam0/data/" + stamp + ".png", "");
    cv::imwrite(file, picture);
  }
  for (int i = -400; i < 10 * images + 400; ++i)
    imu_table += std::to_string(kAslBegin + i * 5000000LL) + ",0.0,0.0,0.0,0.0,9.81,0.0\n";
  folder.write(mav0 + "/cam0/data.csv", image_table);
  folder.write(mav0 + "/imu0/data.csv", imu_table);
  const std::string pose =
      "T_BS:\n  cols: 4\n  rows: 4\n  data: [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, "
      "0.0, 0.0, "
      "0.0, 1.0]\n";
  folder.write(
      mav0 + "/cam0/sensor.yaml",
      "sensor_type: camera\n" + pose +
          "resolution: [752, 480]\ncamera_model: pinhole\nintrinsics: [458.654, 457.296, 367.215, 248.375]\n"
          "distortion_model: radial-tangential\ndistortion_coefficients: [-0.28, 0.07, 0.0002, 0.00002]\n");
  folder.write(mav0 + "/imu0/sensor.yaml",
               "sensor_type: imu\n" + pose +
                   "rate_hz: 200\ngyroscope_noise_density: 1.6968e-04\ngyroscope_random_walk: 1.9393e-05\n"
                   "accelerometer_noise_density: 2.0e-3\naccelerometer_random_walk: 3.0e-3\n");
  return folder.path(name);
}

}  // namespace autocal_vio
