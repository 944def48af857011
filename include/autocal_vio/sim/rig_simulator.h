// A camera-IMU rig moving through a textured room: its whole data stream in order of time.
//
//   RigSimulator simulator(options);  // or (options, loadRigFile("config/simulated_rig.yaml"))
//   while (const std::optional<RigEvent> event = simulator.next()) {
//     // when live: sleep until event->time, the instant at which it happens, IMU clock
//     if (event->type == RigEventType::kImu) publish(event->imu);
//     else publish(simulator.renderImage(*event), event->stamp, event->truth);
//   }
//   simulator.bump(T_CCnew);  // at any time: the mount moves for all images after it
//
// Deterministic: the same options give the same bytes, whichever images are rendered. Own it from one thread.
#pragma once

#include <memory>
#include <opencv2/core/mat.hpp>
#include <optional>

#include "autocal_vio/imu/imu_types.h"
#include "autocal_vio/sim/simulated_rig.h"
#include "autocal_vio/sim/simulated_rig_options.h"
#include "autocal_vio/sim/truth_sample.h"

namespace autocal_vio {

enum class RigEventType { kImu, kImage };

struct RigEvent {
  RigEventType type = RigEventType::kImu;
  TimeNs time = 0;         ///< instant at which it happens, IMU clock; never falls from event to event
  TimeNs stamp = 0;        ///< the message's: IMU clock for samples, camera clock for images (time - td)
  ImuSample imu;           ///< kImu only
  std::int64_t index = 0;  ///< of the image or sample, from 0
  TruthSample truth;       ///< at `time`; with a recorded IMU its biases are not known and zero
};

class RigSimulator {
 public:
  /// EuRoC camera and IMU. Throws std::invalid_argument listing everything wrong with the options or files.
  explicit RigSimulator(const SimulatedRigOptions& options);
  /// Camera and IMU noise as in `sensors`; its priors are ignored.
  RigSimulator(const SimulatedRigOptions& options, const RigModel& sensors);
  ~RigSimulator();
  RigSimulator(const RigSimulator&) = delete;
  RigSimulator& operator=(const RigSimulator&) = delete;

  /// The next event; nothing once the end is reached. At equal times the IMU sample comes first.
  std::optional<RigEvent> next();

  /// The image of a kImage event, CV_8UC1. May be left out for images that nobody wants.
  cv::Mat renderImage(const RigEvent& event) const;

  /// The mount moves: from the next image on T_imu_cam <- T_imu_cam * T_CCnew.
  void bump(const Transform& T_CCnew);

  /// What is true now; rig().rig is what a user would be told.
  const SimulatedRig& rig() const;

  TimeNs begin() const;  ///< IMU clock
  TimeNs end() const;    ///< IMU clock

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace autocal_vio
