// What each stage costs, and the whole chain next to a bare pyramidal Lucas-Kanade on the same images.
//
//   scripts/benchmark
//   scripts/benchmark --benchmark_filter=WholeChain
#include <benchmark/benchmark.h>

#include <algorithm>
#include <array>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>
#include <vector>

#include "autocal_vio/common/stage_clock.h"
#include "autocal_vio/estimator/sliding_window_estimator.h"
#include "autocal_vio/factors/imu_factor.h"
#include "autocal_vio/factors/reprojection_factor.h"
#include "autocal_vio/frontend/feature_tracker.h"
#include "autocal_vio/pipeline/vio_system.h"
#include "autocal_vio/sim/feature_simulator.h"
#include "autocal_vio/sim/rig_simulator.h"
#include "random_states.h"

namespace autocal_vio {
namespace {

constexpr double kSeconds = 30.0;         // of simulated flight
constexpr int kPoints = 200;              // that the bare tracker follows
constexpr std::size_t kFrameImages = 60;  // tracked again and again

struct Flight {
  RigModel rig;
  std::vector<ImuSample> imu;
  std::vector<ImageFrame> images;
};

// Rendered once; 752x480 at 20 Hz, IMU at 200 Hz.
const Flight& flight() {
  static const Flight made = [] {
    SimulatedRigOptions options;
    options.duration = kSeconds;
    RigSimulator simulator(options);
    Flight flight;
    flight.rig = simulator.rig().rig;
    while (const std::optional<RigEvent> event = simulator.next()) {
      if (event->type == RigEventType::kImu) flight.imu.push_back(event->imu);
      if (event->type == RigEventType::kImage)
        flight.images.push_back({event->stamp, simulator.renderImage(*event)});
    }
    return flight;
  }();
  return made;
}

// CPU time of following 200 corners from one image to the next and back [ms]: 21x21, three levels above the base.
double bareLucasKanadeMs(const cv::Mat& from, const cv::Mat& to) {
  std::vector<cv::Point2f> corners, there, back;
  cv::goodFeaturesToTrack(from, corners, kPoints, 0.001, 15.0);
  std::vector<uchar> found;
  const StageClock clock;
  cv::calcOpticalFlowPyrLK(from, to, corners, there, found, cv::noArray(), cv::Size(21, 21), 3);
  cv::calcOpticalFlowPyrLK(to, from, there, back, found, cv::noArray(), cv::Size(21, 21), 3);
  return clock.elapsedMs() * kPoints / static_cast<double>(std::max<std::size_t>(1, corners.size()));
}

double quantile(std::vector<double> values, double q) {
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(q * static_cast<double>(values.size() - 1))];
}

double totalMs(const StageTimes& times) {
  return times.tracking_ms + times.initialization_ms + times.optimization_ms;
}

// From nothing to odometry: all stages of each image, interleaved with the yardstick so that both see the same machine.
void WholeChain(benchmark::State& state) {
  const Flight& data = flight();
  for (auto _ : state) {
    std::vector<double> chain, yardstick;
    VioSystem system(data.rig, VioOptions(),
                     [&](const VioUpdate& update) { chain.push_back(totalMs(update.times)); });
    std::size_t next = 0;
    for (const ImuSample& sample : data.imu) {
      for (; next < data.images.size() && data.images[next].stamp <= sample.stamp; ++next) {
        system.addImage(data.images[next]);
        if (next > 0)
          yardstick.push_back(bareLucasKanadeMs(data.images[next - 1].image, data.images[next].image));
      }
      system.addImu(sample);
    }
    const double bare = quantile(yardstick, 0.5);
    state.counters["lucas_kanade_ms"] = bare;
    state.counters["median_ms"] = quantile(chain, 0.5);
    state.counters["p99_ms"] = quantile(chain, 0.99);
    state.counters["median_over_lk"] = quantile(chain, 0.5) / bare;
    state.counters["p99_over_lk"] = quantile(chain, 0.99) / bare;
    state.counters["max_over_lk"] = quantile(chain, 1.0) / bare;
  }
}
BENCHMARK(WholeChain)->Unit(benchmark::kSecond)->Iterations(1);

void BareLucasKanade(benchmark::State& state) {
  const std::vector<ImageFrame>& images = flight().images;
  std::size_t k = images.size() / 2;
  for (auto _ : state) {
    benchmark::DoNotOptimize(bareLucasKanadeMs(images[k].image, images[k + 1].image));
    k = k + 2 < images.size() ? k + 1 : images.size() / 2;
  }
}
BENCHMARK(BareLucasKanade)->Unit(benchmark::kMillisecond);

void Tracker(benchmark::State& state) {
  const Flight& data = flight();
  FeatureTracker tracker(CameraModel(*data.rig.camera), FeatureTrackerOptions());
  const std::size_t begin = data.images.size() / 2;
  std::size_t k = 0;
  for (auto _ : state) {
    // There and back, so that the motion never jumps.
    const std::size_t phase = k++ % (2 * kFrameImages);
    const std::size_t at = begin + (phase < kFrameImages ? phase : 2 * kFrameImages - 1 - phase);
    benchmark::DoNotOptimize(tracker.track(static_cast<TimeNs>(k) * 50000000, data.images[at].image, {}));
  }
}
BENCHMARK(Tracker)->Unit(benchmark::kMillisecond);

std::vector<ImuSample> samples(std::size_t count) {
  const std::vector<ImuSample>& all = flight().imu;
  return {all.begin() + static_cast<std::ptrdiff_t>(all.size() / 2),
          all.begin() + static_cast<std::ptrdiff_t>(all.size() / 2 + count)};
}

void PreintegrationOf(benchmark::State& state) {
  const std::vector<ImuSample> input = samples(static_cast<std::size_t>(state.range(0)));
  for (auto _ : state)
    benchmark::DoNotOptimize(Preintegration(input, ImuBias(), flight().rig.imu_noise).covariance());
}
BENCHMARK(PreintegrationOf)->Arg(11)->Arg(101)->Unit(benchmark::kMicrosecond);

void ImuFactorEvaluation(benchmark::State& state) {
  test::RandomStates random(1);
  const auto pre = std::make_shared<Preintegration>(samples(41), ImuBias(), flight().rig.imu_noise);
  const ImuFactor factor(pre, Eigen::Vector3d(0.0, 0.0, -9.81));
  FrameState i, j;
  i.setPose(Transform(random.rotation(), random.vector()));
  j.setPose(Transform(random.rotation(), random.vector()));
  const double* parameters[] = {i.pose.data(), i.motion.data(), j.pose.data(), j.motion.data()};
  double residuals[15], jacobian_pi[15 * 7], jacobian_mi[15 * 9], jacobian_pj[15 * 7], jacobian_mj[15 * 9];
  double* jacobians[] = {jacobian_pi, jacobian_mi, jacobian_pj, jacobian_mj};
  for (auto _ : state) benchmark::DoNotOptimize(factor.Evaluate(parameters, residuals, jacobians));
}
BENCHMARK(ImuFactorEvaluation)->Unit(benchmark::kNanosecond);

void ReprojectionFactorEvaluation(benchmark::State& state) {
  test::RandomStates random(2);
  ReprojectionMeasurement m;
  m.normalized = Eigen::Vector2d(0.1, -0.2);
  m.sqrt_information = 458.0 * Eigen::Matrix2d::Identity();
  const ReprojectionFactor factor(m);
  FrameState frame;
  CalibrationState calibration;
  calibration.setTransform(Transform(random.rotation(), random.vector(0.1)));
  const double landmark[3] = {0.1, -0.2, 0.25};
  const double* parameters[] = {frame.pose.data(), calibration.rotation.data(),
                                calibration.translation.data(), &calibration.td, landmark};
  double residuals[2], pose[14], rotation[8], translation[6], td[2], point[6];
  double* jacobians[] = {pose, rotation, translation, td, point};
  for (auto _ : state) benchmark::DoNotOptimize(factor.Evaluate(parameters, residuals, jacobians));
}
BENCHMARK(ReprojectionFactorEvaluation)->Unit(benchmark::kNanosecond);

// Twelve keyframes, a fifth of a second apart, of simulated tracks; the states a little off the truth.
VisualInertialGraph windowGraph() {
  FeatureSimulationOptions options = FeatureSimulationOptions::euroc(1);
  options.motion.duration = 8.0;
  const FeatureDataset data = simulateFeatures(options);
  constexpr std::size_t kStride = 4, kFrames = 12;
  const std::size_t begin = data.frames.size() - kStride * kFrames - 1;
  ImuBuffer imu(60 * kNsPerSecond);
  for (const ImuSample& sample : data.imu) imu.add(sample);
  CalibrationPrior prior;
  prior.T_BC = data.rig.T_imu_cam;
  prior.td = data.rig.td;
  VisualInertialGraph graph{GraphOptions(), prior};
  test::RandomStates random(3);
  for (std::size_t k = 0; k < kFrames; ++k) {
    const std::size_t i = begin + k * kStride;
    const TruthSample& truth = data.truth[i];
    FrameState frame;
    frame.id = graph.nextFrameId();
    frame.stamp = truth.stamp;
    frame.reference_td = truth.td;
    frame.setPose(Transform(truth.T_WB.rotation, truth.T_WB.translation + random.vector(0.01)));
    frame.setMotion(truth.velocity_W + random.vector(0.01), truth.bias);
    frame.measured_angular_velocity = truth.angular_velocity_B + truth.bias.gyroscope;
    frame.features = data.frames[i].features;
    if (k > 0)
      frame.preintegration = std::make_shared<Preintegration>(
          imu.slice(data.truth[i - kStride].stamp_imu, truth.stamp_imu), truth.bias, data.rig.rig.imu_noise);
    graph.addFrame(std::move(frame));
    graph.landmarkMap().closeFullLandmarks();
  }
  graph.anchorFirstFrame(0.1, 0.3);
  return graph;
}

void SolveWindow(benchmark::State& state) {
  const VisualInertialGraph window = windowGraph();
  SolveSummary summary;
  for (auto _ : state) {
    state.PauseTiming();
    VisualInertialGraph graph = window;
    state.ResumeTiming();
    summary = graph.solve(EstimatorOptions().max_iterations, 1e-5, VisualInertialGraph::Depths::kDamped);
  }
  state.counters["iterations"] = summary.iterations;
}
BENCHMARK(SolveWindow)->Unit(benchmark::kMillisecond);

void CovarianceOfWindow(benchmark::State& state) {
  VisualInertialGraph window = windowGraph();
  window.solve(EstimatorOptions().max_iterations, 1e-5);
  for (auto _ : state) benchmark::DoNotOptimize(window.covariance());
}
BENCHMARK(CovarianceOfWindow)->Unit(benchmark::kMillisecond);

void MarginalizeOldest(benchmark::State& state) {
  VisualInertialGraph window = windowGraph();
  window.solve(EstimatorOptions().max_iterations, 1e-5);
  for (auto _ : state) {
    state.PauseTiming();
    VisualInertialGraph graph = window;
    state.ResumeTiming();
    graph.marginalizeOldest();
  }
}
BENCHMARK(MarginalizeOldest)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace autocal_vio

// One thread: CPU time is that of the caller, here and in what is compared with.
int main(int argc, char** argv) {
  cv::setNumThreads(0);
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
  benchmark::RunSpecifiedBenchmarks();
  benchmark::Shutdown();
  return 0;
}
