#include "autocal_vio/pipeline/vio_system.h"

#include <algorithm>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <set>
#include <stdexcept>
#include <utility>

#include "autocal_vio/common/stage_clock.h"
#include "autocal_vio/estimator/bump_detector.h"
#include "autocal_vio/frontend/feature_tracker.h"
#include "autocal_vio/frontend/rolling_shutter.h"
#include "autocal_vio/imu/imu_plausibility.h"
#include "autocal_vio/pipeline/measurement_sync.h"
#include "autocal_vio/pipeline/session.h"

namespace autocal_vio {
namespace {

void setProblem(std::string* problem, const std::string& text) {
  if (problem) *problem = text;
}

std::string sizeText(const cv::Size& size) {
  return std::to_string(size.width) + "x" + std::to_string(size.height);
}

CameraModel makeCamera(const RigModel& rig, const VioOptions& options) {
  std::vector<std::string> problems = validateAll(options);
  const std::vector<std::string> noise = rig.imu_noise.validate();
  problems.insert(problems.end(), noise.begin(), noise.end());
  if (!rig.camera) problems.push_back("no camera intrinsics");
  if (options.fix_extrinsics && !rig.extrinsics_prior)
    problems.push_back("fix_extrinsics needs extrinsics to hold");
  if (rig.camera) {
    const std::vector<std::string> camera = rig.camera->validate();
    problems.insert(problems.end(), camera.begin(), camera.end());
  }
  if (problems.empty()) return CameraModel(*rig.camera);
  std::string text;
  for (const std::string& problem : problems) text += (text.empty() ? "" : "; ") + problem;
  throw std::invalid_argument(text);
}

}  // namespace

class VioSystem::Impl {
 public:
  Impl(const RigModel& rig, const VioOptions& options, UpdateSink sink)
      : camera_(makeCamera(rig, options)),
        rig_(rig),
        options_(options),
        sink_(std::move(sink)),
        tracker_(camera_, options.tracker),
        rolling_shutter_(rig.camera->readout_time, rig.camera->height) {
    startSession(rig_, std::nullopt);
    session_->describeBeginning(&update_);
  }

  void addImu(const ImuSample& sample) {
    switch (sync_.addImu(sample)) {
      case MeasurementSync::ImuVerdict::kAdded:
        break;
      case MeasurementSync::ImuVerdict::kGlitchLeftOut:
        ++counters_.imu_unusable;
        break;
      case MeasurementSync::ImuVerdict::kNotFinite:
        ++counters_.imu_unusable;
        return;
      case MeasurementSync::ImuVerdict::kOutOfOrder:
        ++counters_.imu_out_of_order;
        return;
      case MeasurementSync::ImuVerdict::kTimeJumpedBack:
        restartClock();
        sync_.addImu(sample);
        break;
    }
    imu_plausibility_.add(sample);
    processReady();
  }

  bool addFrame(PendingFrame frame, std::string* problem) {
    bool dropped = false;
    MeasurementSync::FrameVerdict verdict = sync_.addFrame(frame, &dropped);
    if (verdict == MeasurementSync::FrameVerdict::kTimeJumpedBack) {
      restartClock();
      verdict = sync_.addFrame(std::move(frame), &dropped);
    }
    if (verdict == MeasurementSync::FrameVerdict::kOutOfOrder) {
      ++counters_.images_dropped;
      setProblem(problem, "the image's stamp is not newer than the last");
      return false;
    }
    counters_.images_dropped += verdict == MeasurementSync::FrameVerdict::kReplacesLast;
    countUncovered(dropped ? 1 : 0);
    processReady();
    return true;
  }

  bool addImage(const ImageFrame& frame, std::string* problem) {
    const cv::Size calibrated(camera_.width(), camera_.height());
    if (frame.image.type() != CV_8UC1 || frame.image.size() != calibrated) {
      ++counters_.images_dropped;
      setProblem(problem, frame.image.type() != CV_8UC1
                              ? "the image is not 8-bit grey"
                              : "the image is " + sizeText(frame.image.size()) +
                                    " pixels, the camera's intrinsics are those of " + sizeText(calibrated));
      return false;
    }
    PendingFrame pending;
    pending.stamp = frame.stamp;
    pending.image = frame.image;
    return addFrame(std::move(pending), problem);
  }

  void reset(bool keep_calibration) {
    ++counters_.resets;
    const RigModel rig = keep_calibration ? rigWithCalibration() : rig_;
    if (!keep_calibration) frozen_.reset();
    tracker_.reset();
    last_processed_.reset();
    ages_.clear();
    lost_because_.clear();
    startSession(rig, session_->lastPose());
    update_ = VioUpdate();
    session_->describeBeginning(&update_);
    update_.counters = counters_;
  }

  bool freeze(const FreezeSelection& selection, std::string* problem) {
    const bool all = selection.rotation && selection.translation,
               any = selection.rotation || selection.translation;
    if (options_.fix_extrinsics && !all) {
      setProblem(problem, "fix_extrinsics holds rotation and translation for as long as the nodelet runs");
      return false;
    }
    if (any && !session_->estimating() && !session_rig_.extrinsics_prior) {
      setProblem(problem, "there are no extrinsics to hold yet: " + update_.reason);
      return false;
    }
    frozen_ = selection;
    session_->hold(selection);
    session_->describeState(&update_);
    return true;
  }

  bool calibrationKnown() const { return session_->estimating() || session_rig_.extrinsics_prior; }
  const CameraModel& camera() const { return camera_; }
  const VioUpdate& lastUpdate() const { return update_; }
  const VioCounters& counters() const { return counters_; }
  std::size_t imagesWaiting() const { return sync_.framesWaiting(); }

 private:
  void startSession(const RigModel& rig, const std::optional<Transform>& start_pose) {
    session_rig_ = rig;
    session_ = std::make_unique<Session>(camera_.focalLength(), rig, options_, start_pose);
    if (frozen_) session_->hold(*frozen_);
  }

  // What is known of the calibration now: the running estimate, else what the session began with.
  RigModel rigWithCalibration() const {
    RigModel rig = session_rig_;
    if (const std::optional<CalibrationKnowledge> knowledge = session_->knowledge()) {
      rig.extrinsics_prior = knowledge->extrinsics;
      rig.time_offset_prior = knowledge->time_offset;
    }
    if (const std::optional<ExtrinsicsPrior> held = session_->heldExtrinsics()) rig.extrinsics_prior = held;
    if (const std::optional<TimeOffsetPrior> held = session_->heldTimeOffset()) rig.time_offset_prior = *held;
    if (options_.fix_extrinsics) rig.extrinsics_prior = rig_.extrinsics_prior;
    return rig;
  }

  // The clock went back (a bag played in a loop): nothing buffered is of use, the calibration is.
  // Messages that were on their way meanwhile may bring the old clock back for a moment: no second reset for that.
  void restartClock() {
    counters_.images_dropped += sync_.framesWaiting();
    sync_.clear();
    imu_plausibility_ = ImuPlausibility();
    if (!last_processed_) return;
    const bool estimating = session_->estimating();
    reset(true);
    if (estimating) lost_because_ = "the clock went back";
  }

  void processReady() {
    int dropped = 0;
    while (std::optional<PendingFrame> frame = sync_.pop(session_->td(), &dropped)) {
      countUncovered(static_cast<std::size_t>(dropped));
      process(std::move(*frame));
    }
    countUncovered(static_cast<std::size_t>(dropped));
  }

  void countUncovered(std::size_t images) {
    counters_.images_dropped += images;
    counters_.images_uncovered += images;
  }

  // What throws on its way leaves the update before, and so the calibration as it was last known.
  void process(PendingFrame pending) {
    VioUpdate before = std::exchange(update_, VioUpdate());
    try {
      processInto(std::move(pending));
    } catch (...) {
      update_ = std::move(before);
      update_.counters = counters_;
      throw;
    }
    sink_(update_);
  }

  void processInto(PendingFrame pending) {
    update_.stamp = pending.stamp;
    FeatureFrame frame = pending.features ? std::move(*pending.features) : track(pending);
    fillTracks(frame);
    frame = rolling_shutter_.correct(std::move(frame));
    last_processed_ = pending.stamp;
    const bool sound = session_->process(frame, sync_.imu(), &update_);
    if (const std::set<std::int64_t>* wandering = session_->wanderingTracks()) tracker_.drop(*wandering);
    if (!options_.fix_extrinsics) doubtPriors();
    doubtTimeOffset();
    if (!sound) {
      ++counters_.resets;
      const RigModel rig = rigWithCalibration();
      startSession(rig, session_->lastPose());
      lost_because_ = update_.reason;
    } else if (session_->estimating()) {
      lost_because_.clear();
    } else if (!lost_because_.empty()) {
      update_.state = VioState::kLost;
      update_.reason = lost_because_ + "; starting again: " + update_.reason;
    }
    remark();
    const std::string imu_problem = imu_plausibility_.problem();
    if (!imu_problem.empty()) update_.reason = imu_problem + "; " + update_.reason;
    ++counters_.images_processed;
    update_.counters = counters_;
  }

  // What the data have contradicted must not come back with the next session. Where that was a session's own estimate, the
  // mount has moved, and what the user has given says less.
  void doubtPriors() {
    const bool contradicted = session_->priorContradicted();
    if (contradicted && session_->priorGiven()) given_problem_ = session_->priorProblem();
    for (RigModel* rig : {&rig_, &session_rig_}) {
      if (!rig->extrinsics_prior) continue;
      if (contradicted && rig->extrinsics_prior->from_session != session_->priorGiven())
        rig->extrinsics_prior.reset();
      else if (contradicted || session_->mountMayHaveMoved())
        rig->extrinsics_prior = withinABump(*rig->extrinsics_prior);
    }
  }

  // The same of the time offset.
  void doubtTimeOffset() {
    const std::string& problem = session_->timeOffsetProblem();
    if (problem.empty()) return;
    if (!session_rig_.time_offset_prior.from_session) given_td_problem_ = problem;
    for (RigModel* rig : {&rig_, &session_rig_})
      if (rig->time_offset_prior.from_session == session_rig_.time_offset_prior.from_session)
        rig->time_offset_prior.sigma_td = TimeOffsetPrior().sigma_td;
  }

  // The user has to mend the file: that is said for as long as the process runs.
  void remark() {
    if (!session_->priorProblem().empty())
      update_.reason = session_->priorProblem() + "; " + update_.reason;
    else if (!given_problem_.empty())
      update_.reason = given_problem_ + "; " + update_.reason;
    if (!session_->timeOffsetProblem().empty())
      update_.reason = session_->timeOffsetProblem() + "; " + update_.reason;
    else if (!given_td_problem_.empty())
      update_.reason = given_td_problem_ + "; " + update_.reason;
  }

  FeatureFrame track(const PendingFrame& pending) {
    const StageClock clock;
    std::optional<Eigen::Matrix3d> prediction;
    if (last_processed_)
      prediction = session_->predictedRotation(*last_processed_, pending.stamp, sync_.imu());
    FeatureFrame frame = tracker_.track(pending.stamp, pending.image, prediction);
    update_.times.tracking_ms = clock.elapsedMs();
    return frame;
  }

  void fillTracks(const FeatureFrame& frame) {
    update_.tracked_features = static_cast<int>(frame.features.size());
    std::vector<std::pair<std::int64_t, int>> ages;
    for (const Feature& feature : frame.features) {
      const auto before = std::lower_bound(ages_.begin(), ages_.end(), std::make_pair(feature.track_id, 0));
      const int age = before != ages_.end() && before->first == feature.track_id ? before->second + 1 : 1;
      ages.emplace_back(feature.track_id, age);
      update_.tracks.push_back({feature.track_id, feature.pixel, age, false});
    }
    ages_ = std::move(ages);
  }

  CameraModel camera_;
  RigModel rig_, session_rig_;
  VioOptions options_;
  UpdateSink sink_;
  FeatureTracker tracker_;
  RollingShutter rolling_shutter_;
  MeasurementSync sync_;
  ImuPlausibility imu_plausibility_;
  std::unique_ptr<Session> session_;
  std::optional<FreezeSelection> frozen_;
  std::optional<TimeNs> last_processed_;
  std::vector<std::pair<std::int64_t, int>> ages_;  ///< of the tracks in the last image, by ascending id
  std::string lost_because_;
  std::string given_problem_;     ///< what was wrong with the extrinsics that the user gave, in words
  std::string given_td_problem_;  ///< and with the time offset
  VioCounters counters_;
  VioUpdate update_;
};

VioSystem::VioSystem(const RigModel& rig, const VioOptions& options, UpdateSink sink)
    : impl_(std::make_unique<Impl>(rig, options, std::move(sink))) {}

VioSystem::~VioSystem() = default;

void VioSystem::addImu(const ImuSample& sample) {
  impl_->addImu(sample);
}

bool VioSystem::addImage(const ImageFrame& frame, std::string* problem) {
  return impl_->addImage(frame, problem);
}

bool VioSystem::addFeatures(const FeatureFrame& frame, std::string* problem) {
  PendingFrame pending;
  pending.stamp = frame.stamp;
  pending.features = frame;
  return impl_->addFrame(std::move(pending), problem);
}

void VioSystem::reset(bool keep_calibration) {
  impl_->reset(keep_calibration);
}

bool VioSystem::freeze(const FreezeSelection& selection, std::string* problem) {
  return impl_->freeze(selection, problem);
}

bool VioSystem::calibrationKnown() const {
  return impl_->calibrationKnown();
}

const CameraModel& VioSystem::camera() const {
  return impl_->camera();
}

const VioUpdate& VioSystem::lastUpdate() const {
  return impl_->lastUpdate();
}

const VioCounters& VioSystem::counters() const {
  return impl_->counters();
}

std::size_t VioSystem::imagesWaiting() const {
  return impl_->imagesWaiting();
}

}  // namespace autocal_vio
