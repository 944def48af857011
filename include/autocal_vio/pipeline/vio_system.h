// The one facade of the core: IMU samples and images in, VioUpdate values out.
//
// Deterministic and single-threaded: the same calls give the same updates, bit for bit. Own it from one
// thread (pipeline/worker.h does that for live use).
#pragma once

#include <functional>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

#include "autocal_vio/frontend/feature.h"
#include "autocal_vio/imu/imu_types.h"
#include "autocal_vio/pipeline/vio_options.h"
#include "autocal_vio/pipeline/vio_update.h"
#include "autocal_vio/rig/rig_model.h"

namespace autocal_vio {

/// A grey image with its stamp in the camera clock.
struct ImageFrame {
  TimeNs stamp = 0;
  cv::Mat image;  ///< CV_8UC1, size of the camera model
};

class VioSystem {
 public:
  using UpdateSink = std::function<void(const VioUpdate&)>;

  /// `rig.camera` must be set. Throws std::invalid_argument listing everything wrong with `rig` and
  /// `options`. `sink` is called once for each image processed, from within the add* calls.
  VioSystem(const RigModel& rig, const VioOptions& options, UpdateSink sink);
  ~VioSystem();
  VioSystem(const VioSystem&) = delete;
  VioSystem& operator=(const VioSystem&) = delete;

  /// Adds one IMU sample; processes every waiting image that the IMU now covers.
  /// Samples that are not finite or not newer than the last are dropped and counted.
  void addImu(const ImuSample& sample);

  /// Adds an image; it is processed as soon as the IMU covers its stamp + td.
  /// Images of the wrong size or type, or out of order, are dropped and counted; `problem` (optional) says
  /// why.
  bool addImage(const ImageFrame& image, std::string* problem = nullptr);

  /// Adds tracks instead of an image (feature-level simulation and tests).
  bool addFeatures(const FeatureFrame& frame, std::string* problem = nullptr);

  /// Starts anew. `keep_calibration`: goes on with the calibration as a prior, and holds what is held; otherwise from what
  /// the rig file gives, and what was held is released. The odometry goes on from the last pose.
  void reset(bool keep_calibration);

  /// Holds the parts of `selection` and releases the others. Held parts keep every bit. False, with nothing changed, where
  /// there are no extrinsics to hold yet, or where VioOptions::fix_extrinsics holds them; `problem` (optional) says why.
  bool freeze(const FreezeSelection& selection, std::string* problem = nullptr);

  /// Extrinsics are known: estimated, or given or kept from before.
  bool calibrationKnown() const;

  const CameraModel& camera() const;

  /// The state as of the last update, and what freeze() has changed; after reset() what is known before the next image.
  const VioUpdate& lastUpdate() const;

  /// The counters as of now: also what came after the last update.
  const VioCounters& counters() const;
  /// Images that wait for the IMU to cover them.
  std::size_t imagesWaiting() const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace autocal_vio
