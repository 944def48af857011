// The chain's resident memory: small, and flat however long it runs.
//
//   AUTOCAL_VIO_MINUTES=30 test_memory      // tracks for 30 min, images for a tenth of it
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <string>
#include <vector>

#include "autocal_vio/pipeline/vio_system.h"
#include "autocal_vio/sim/imu_simulator.h"
#include "autocal_vio/sim/rig_simulator.h"
#include "autocal_vio/sim/sine_trajectory.h"
#include "endless_tracks.h"

namespace autocal_vio {
namespace {

constexpr double kLargest = 150.0;  // [MB] resident
constexpr double kGrowth = 1.0;     // [MB] over all but the first third: more is no jitter of the allocator

double minutes(double standard) {
  const char* wanted = std::getenv("AUTOCAL_VIO_MINUTES");
  return wanted ? std::atof(wanted) : standard;
}

// Resident set of this process [MB].
double residentMb() {
  std::ifstream file("/proc/self/statm");
  long total = 0, resident = 0;
  file >> total >> resident;
  return static_cast<double>(resident) * static_cast<double>(sysconf(_SC_PAGESIZE)) / 1e6;
}

// One sample each second of simulated time.
class MemoryRecord {
 public:
  explicit MemoryRecord(const char* name) : name_(name), before_(residentMb()) { samples_.reserve(10000); }

  void add(TimeNs stamp) {
    if (samples_.empty()) begin_ = stamp;
    if (toSeconds(stamp - begin_) < static_cast<double>(samples_.size())) return;
    samples_.push_back(residentMb());
    if (samples_.size() % 60 == 0) print();
  }

  void check() const {
    ASSERT_GT(samples_.size(), 30U);
    const std::size_t third = samples_.size() / 3;
    const double largest = *std::max_element(samples_.begin(), samples_.end());
    const double growth = samples_.back() - samples_[third];
    const double per_minute = 60.0 * growth / static_cast<double>(samples_.size() - 1 - third);
    std::printf(
        "%s | resident before the chain %.1f MB, after a third %.1f MB, at the end %.1f MB, at most %.1f MB; "
        "%.2f MB/min over the last two thirds of %.1f min\n",
        name_, before_, samples_[third], samples_.back(), largest, per_minute,
        static_cast<double>(samples_.size()) / 60.0);
#ifdef AUTOCAL_VIO_OPTIMIZED  // sanitizers keep what is freed
    EXPECT_LT(largest, kLargest);
    EXPECT_LT(growth, kGrowth);
#endif
  }

 private:
  void print() const {
    std::printf("%s: %zu s, %.1f MB\n", name_, samples_.size(), samples_.back());
    std::fflush(stdout);
  }

  const char* name_;
  double before_;
  TimeNs begin_ = 0;
  std::vector<double> samples_;
};

// Images and how many of them gave odometry.
struct TrackRun {
  int images = 0, odometry = 0;
  std::string last_reason;
};

TrackRun runOnTracks(MotionKind kind, const char* name) {
  SineTrajectoryOptions motion;
  motion.kind = kind;
  motion.duration = 60.0 * minutes(0.75);
  const SineTrajectory trajectory(motion);
  const SimulatedRig rig = randomRig(1);
  ImuSimulator imu(trajectory, rig, ImuSimulatorOptions());
  EndlessTracks tracks(*rig.rig.camera, 5.0, 2000, 150);
  MemoryRecord memory(name);
  TrackRun run;
  VioSystem system(rig.rig, VioOptions(), [&](const VioUpdate& update) {
    ++run.images;
    run.odometry += update.odometry.has_value();
    run.last_reason = update.reason;
    memory.add(update.stamp);
  });
  const TimeNs interval = fromSeconds(0.05);
  TimeNs next_image = trajectory.begin();
  while (imu.nextStamp() <= trajectory.end()) {
    const ImuSample sample = imu.next();
    for (; next_image <= sample.stamp; next_image += interval)
      system.addFeatures(tracks.observe(next_image, trajectory.at(next_image).T_WB * rig.T_imu_cam, 0.5));
    system.addImu(sample);
  }
  memory.check();
  return run;
}

TEST(Memory, FlatOnTracks) {
  const TrackRun run = runOnTracks(MotionKind::kFree, "tracks");
  EXPECT_GT(run.odometry, run.images - 20 * 10);  // it was not idle
}

TEST(Memory, FlatWhileTheInitializationWaits) {
  const TrackRun one_axis = runOnTracks(MotionKind::kOneAxisRotation, "one axis");
  EXPECT_EQ(one_axis.odometry, 0);
  EXPECT_EQ(one_axis.last_reason, "rotation about one axis only");
  const TrackRun turning = runOnTracks(MotionKind::kPureRotation, "pure rotation");  // attempts, all in vain
  EXPECT_EQ(turning.odometry, 0);
}

TEST(Memory, FlatOnImages) {
  if (!std::getenv("AUTOCAL_VIO_MINUTES")) GTEST_SKIP() << "set AUTOCAL_VIO_MINUTES";
  SimulatedRigOptions options;
  options.duration = 6.0 * minutes(0.0);
  RigSimulator simulator(options);
  MemoryRecord memory("images (the renderer counts)");
  VioSystem system(simulator.rig().rig, VioOptions(),
                   [&](const VioUpdate& update) { memory.add(update.stamp); });
  while (const std::optional<RigEvent> event = simulator.next()) {
    if (event->type == RigEventType::kImu) {
      system.addImu(event->imu);
    } else {
      system.addImage({event->stamp, simulator.renderImage(*event)});
    }
  }
  memory.check();
}

}  // namespace
}  // namespace autocal_vio
