#include "autocal_vio/initializer/linear_alignment.h"

#include <ceres/ceres.h>
#include <gtest/gtest.h>

#include "alignment_scene.h"
#include "autocal_vio/initializer/alignment_equations.h"

namespace autocal_vio {
namespace {

using Eigen::Vector3d;
using test::angleBetween;
using test::makeScene;
using test::Scene;
using test::SceneOptions;
using test::SineTrajectory;

TEST(ApproximateAlignment, ExactToRoundingOnPropagatedData) {
  SceneOptions options;
  options.propagate = true;
  const Scene scene = makeScene(options);
  const ApproximateAlignment result = approximateScaleGravityTranslation(scene.input());
  ASSERT_TRUE(result.ok()) << result.failure;
  EXPECT_NEAR(result.scale, options.scale, 1e-9);
  EXPECT_LT((result.g_V - scene.g_V).norm(), 1e-9);
  EXPECT_LT((result.p_BC - options.p_BC).norm(), 1e-9);
  EXPECT_LT((result.p_BC + scene.R_BC * result.p_CB).norm(), 1e-14);
  EXPECT_LT(result.rms_residual, 1e-10);
  EXPECT_EQ(result.singular_values.size(), 7);
  EXPECT_GT(result.singular_values(6), 0.0);
  EXPECT_LT(result.condition, 1e4);
}

TEST(ApproximateAlignment, FiveKeyframesSuffice) {
  SceneOptions options;
  options.propagate = true;
  options.keyframes = 5;
  const Scene scene = makeScene(options);
  const ApproximateAlignment result = approximateScaleGravityTranslation(scene.input());
  ASSERT_TRUE(result.ok()) << result.failure;
  EXPECT_NEAR(result.scale, options.scale, 1e-7);
}

// Against the closed form the error is the integration's, of second order in the sampling interval.
TEST(ApproximateAlignment, ErrorOnClosedFormIsTheIntegrationError) {
  double previous_error = 1.0;
  for (const double rate : {250.0, 1000.0, 4000.0}) {
    SceneOptions options;
    options.imu_rate = rate;
    const Scene scene = makeScene(options);
    const ApproximateAlignment result = approximateScaleGravityTranslation(scene.input());
    ASSERT_TRUE(result.ok()) << result.failure;
    const double error = std::abs(result.scale / options.scale - 1.0) + (result.g_V - scene.g_V).norm() +
                         (result.p_BC - options.p_BC).norm();
    EXPECT_LT(error, previous_error / 10.0);
    previous_error = error;
  }
  EXPECT_LT(previous_error, 2e-6);
}

TEST(Refinement, ExactToRoundingWithAccelerometerBias) {
  SceneOptions options;
  options.propagate = true;
  options.accelerometer_bias = Vector3d(0.12, -0.2, 0.15);
  const Scene scene = makeScene(options);
  const ApproximateAlignment start = approximateScaleGravityTranslation(scene.input());
  ASSERT_TRUE(start.ok()) << start.failure;
  EXPECT_GT((start.g_V - scene.g_V).norm(), 1e-3) << "the bias must disturb the approximate step";
  const Alignment result = refineWithAccelerometerBias(scene.input(), start, AlignmentOptions());
  ASSERT_TRUE(result.ok()) << result.failure;
  EXPECT_NEAR(result.scale, options.scale, 1e-8);
  EXPECT_LT((result.g_V - scene.g_V).norm(), 1e-8);
  EXPECT_LT((result.accelerometer_bias - options.accelerometer_bias).norm(), 1e-8);
  EXPECT_LT((result.p_BC - options.p_BC).norm(), 1e-8);
  EXPECT_NEAR(result.g_V.norm(), options.gravity, 1e-12);
  EXPECT_LT((result.R_VW * Vector3d(0, 0, -options.gravity) - result.g_V).norm(), 1e-12);
}

TEST(Refinement, BiasOfThePreintegrationIsCounted) {
  SceneOptions options;
  options.propagate = true;
  options.accelerometer_bias = Vector3d(0.12, -0.2, 0.15);
  Scene scene = makeScene(options);
  ImuBias bias;
  bias.accelerometer = Vector3d(0.1, 0.1, 0.1);
  for (Preintegration& imu : scene.preintegrations) imu.repropagate(bias);
  const Alignment result = refineWithAccelerometerBias(
      scene.input(), approximateScaleGravityTranslation(scene.input()), AlignmentOptions());
  ASSERT_TRUE(result.ok()) << result.failure;
  EXPECT_LT((result.accelerometer_bias - options.accelerometer_bias).norm(), 1e-8);
}

TEST(Refinement, WeightedIsExactOnExactData) {
  SceneOptions options;
  options.propagate = true;
  options.accelerometer_bias = Vector3d(0.12, -0.2, 0.15);
  const Scene scene = makeScene(options);
  AlignmentOptions weighted;
  weighted.noise.emplace();
  weighted.noise->sigma_position = 1e-3;
  weighted.noise->sigma_rotation = 1e-3;
  weighted.noise->sigma_accelerometer_bias = 0.0;
  const Alignment result =
      refineWithAccelerometerBias(scene.input(), approximateScaleGravityTranslation(scene.input()), weighted);
  ASSERT_TRUE(result.ok()) << result.failure;
  EXPECT_NEAR(result.scale, options.scale, 1e-8);
  EXPECT_LT((result.g_V - scene.g_V).norm(), 1e-8);
  EXPECT_LT((result.accelerometer_bias - options.accelerometer_bias).norm(), 1e-8);
  EXPECT_LT((result.p_BC - options.p_BC).norm(), 1e-8);
  EXPECT_LT(result.chi2_per_dof, 1e-10);
}

TEST(Refinement, ResultDoesNotDependOnStartOrIterationsAfterConvergence) {
  SceneOptions options;
  options.imu_noise = true;
  options.sigma_position = 2e-4;
  const Scene scene = makeScene(options);
  const ApproximateAlignment start = approximateScaleGravityTranslation(scene.input());
  ASSERT_TRUE(start.ok()) << start.failure;
  ApproximateAlignment far = start;
  far.scale *= 1.5;
  far.g_V = Eigen::AngleAxisd(0.3, Vector3d(1, 2, -1).normalized()) * far.g_V;
  for (const bool with_noise : {false, true}) {
    AlignmentOptions normal, tight;
    if (with_noise) {
      normal.noise.emplace();
      normal.noise->sigma_position = options.sigma_position;
    }
    tight = normal;
    tight.step_tolerance = 1e-12;
    const Alignment a = refineWithAccelerometerBias(scene.input(), start, normal);
    const Alignment b = refineWithAccelerometerBias(scene.input(), start, tight);
    const Alignment c = refineWithAccelerometerBias(scene.input(), far, normal);
    ASSERT_TRUE(a.ok() && b.ok() && c.ok()) << a.failure << b.failure << c.failure;
    EXPECT_GT(c.iterations, a.iterations);
    for (const Alignment* other : {&b, &c}) {
      EXPECT_NEAR(a.scale, other->scale, 1e-7);
      EXPECT_LT((a.g_V - other->g_V).norm(), 1e-7);
      EXPECT_LT((a.accelerometer_bias - other->accelerometer_bias).norm(), 1e-7);
      EXPECT_LT((a.p_BC - other->p_BC).norm(), 1e-7);
    }
  }
}

// The same least squares as the refinement, with every visual pose free under its prior, for Ceres to solve
// by numeric differentiation: scale, gravity direction, accelerometer bias, p_CB, 6N pose corrections.
struct AlignmentCost {
  bool operator()(double const* const* x, double* residuals) const {
    const double scale = x[0][0];
    const Vector3d bias(x[0][3], x[0][4], x[0][5]), p_CB(x[0][6], x[0][7], x[0][8]);
    const Vector3d g_V = R_VW * expSo3(Vector3d(x[0][1], x[0][2], 0.0)) * Vector3d(0, 0, -9.81);
    std::vector<AlignmentKeyframe> keyframes = scene.keyframes;
    const int n = static_cast<int>(keyframes.size());
    Eigen::Map<Eigen::VectorXd> r(residuals, 3 * (n - 2) + 3 + (weighted ? 6 * n : 0));
    if (weighted) {
      for (int k = 0; k < n; ++k) {
        const Eigen::Map<const Vector3d> dp(x[1] + 6 * k), dtheta(x[1] + 6 * k + 3);
        keyframes[k].p_VC += dp;
        keyframes[k].R_VC = keyframes[k].R_VC * expSo3(dtheta);
        r.segment<3>(3 * (n - 2) + 3 + 6 * k) = dp / sigma_position;
        r.segment<3>(3 * (n - 2) + 3 + 6 * k + 3) = dtheta / sigma_rotation;
      }
    }
    const AlignmentInput input{keyframes, scene.preintegrations, scene.R_BC};
    const AlignmentEquations e = alignmentEquations(input);
    const Eigen::VectorXd d =
        e.lambda * scale + e.phi * p_CB + e.psi * bias - e.gamma - g_V.replicate(n - 2, 1);
    r.head(3 * (n - 2)) = d;
    if (weighted) {
      const AlignmentInput measured{scene.keyframes, scene.preintegrations, scene.R_BC};
      r.head(3 * (n - 2)) = imuCovariance(measured).llt().matrixL().solve(d);
    }
    r.segment<3>(3 * (n - 2)) = weighted ? (bias / 0.3).eval() : Vector3d::Zero().eval();
    return true;
  }

  const Scene& scene;
  Eigen::Quaterniond R_VW;
  bool weighted;
  double sigma_position, sigma_rotation;
};

TEST(Refinement, EqualsCeres) {
  for (const bool with_noise : {false, true}) {
    SceneOptions options;
    options.keyframes = 10;
    options.imu_noise = true;
    options.sigma_position = 3e-4;
    options.sigma_rotation = 3e-4;
    options.accelerometer_bias = Vector3d(0.05, 0.02, -0.1);
    const Scene scene = makeScene(options);
    const ApproximateAlignment start = approximateScaleGravityTranslation(scene.input());
    ASSERT_TRUE(start.ok()) << start.failure;
    AlignmentOptions alignment_options;
    if (with_noise) {
      alignment_options.noise.emplace();
      alignment_options.noise->sigma_position = options.sigma_position;
      alignment_options.noise->sigma_rotation = options.sigma_rotation;
    }
    const Alignment result = refineWithAccelerometerBias(scene.input(), start, alignment_options);
    ASSERT_TRUE(result.ok()) << result.failure;

    const Eigen::Quaterniond R_VW = rotationFromZ(-start.g_V);
    const int n = options.keyframes;
    auto* cost = new ceres::DynamicNumericDiffCostFunction<AlignmentCost, ceres::CENTRAL>(
        new AlignmentCost{scene, R_VW, with_noise, options.sigma_position, options.sigma_rotation});
    double x[9] = {start.scale, 0, 0, 0, 0, 0, start.p_CB.x(), start.p_CB.y(), start.p_CB.z()};
    std::vector<double> poses(6 * n, 0.0);
    cost->AddParameterBlock(9);
    cost->AddParameterBlock(6 * n);
    cost->SetNumResiduals(3 * (n - 2) + 3 + (with_noise ? 6 * n : 0));
    ceres::Problem problem;
    problem.AddResidualBlock(cost, nullptr, x, poses.data());
    if (!with_noise) problem.SetParameterBlockConstant(poses.data());
    ceres::Solver::Options solver;
    solver.linear_solver_type = ceres::DENSE_QR;
    solver.max_num_iterations = 200;
    solver.function_tolerance = 1e-16;
    solver.parameter_tolerance = 1e-14;
    solver.gradient_tolerance = 1e-16;
    solver.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(solver, &problem, &summary);

    const Vector3d g_V = R_VW * expSo3(Vector3d(x[1], x[2], 0.0)) * Vector3d(0, 0, -9.81);
    EXPECT_NEAR(result.scale, x[0], 2e-6 * x[0]) << summary.BriefReport();
    EXPECT_LT((result.g_V - g_V).norm(), 1e-5);
    EXPECT_LT((result.accelerometer_bias - Vector3d(x[3], x[4], x[5])).norm(), 1e-5);
    EXPECT_LT((result.p_CB - Vector3d(x[6], x[7], x[8])).norm(), 1e-6);
  }
}

struct Spread {
  double nees = 0.0;        // mean over the seeds; 9 when the covariance is right
  double mean_scale = 0.0;  // mean relative error
  double rms_scale = 0.0;   // relative
  double rms_p_BC = 0.0;    // [m]
};

Spread monteCarlo(bool weighted, int seeds) {
  Spread spread;
  std::mt19937 random(5);
  std::normal_distribution<double> gauss(0.0, 1.0);
  for (int seed = 0; seed < seeds; ++seed) {
    SceneOptions options;
    options.seed = 100 + seed;
    options.imu_noise = true;
    options.sigma_position = 1e-3;
    options.sigma_rotation = 5e-4;
    for (int i = 0; i < 3; ++i) options.accelerometer_bias(i) = 0.1 * gauss(random);
    const Scene scene = makeScene(options);
    ApproximateAlignment start = approximateScaleGravityTranslation(scene.input());
    AlignmentOptions alignment_options;
    if (weighted) {
      alignment_options.noise.emplace();
      alignment_options.noise->sigma_position = options.sigma_position;
      alignment_options.noise->sigma_rotation = options.sigma_rotation;
      alignment_options.noise->sigma_accelerometer_bias = 0.1;
    }
    const Alignment result = refineWithAccelerometerBias(scene.input(), start, alignment_options);
    EXPECT_TRUE(result.ok()) << result.failure;
    if (!result.ok()) continue;
    Eigen::Matrix<double, 9, 1> error;
    error(0) = result.scale - options.scale;
    // The truth is R_VW Exp(-error) g_W.
    const Vector3d g_W = result.R_VW.conjugate() * scene.g_V.normalized();
    error.segment<2>(1) = Eigen::Vector2d(-g_W.y(), g_W.x());
    error.segment<3>(3) = result.accelerometer_bias - options.accelerometer_bias;
    error.segment<3>(6) = result.p_BC - options.p_BC;
    spread.nees += error.dot(result.covariance.ldlt().solve(error)) / seeds;
    spread.mean_scale += error(0) / options.scale / seeds;
    spread.rms_scale += error(0) * error(0) / (options.scale * options.scale) / seeds;
    spread.rms_p_BC += error.tail<3>().squaredNorm() / seeds;
  }
  spread.rms_scale = std::sqrt(spread.rms_scale);
  spread.rms_p_BC = std::sqrt(spread.rms_p_BC);
  return spread;
}

TEST(ApproximateAlignment, NoiseGivesSmallErrorsInProportion) {
  double scale[2] = {0.0, 0.0}, gravity[2] = {0.0, 0.0}, translation[2] = {0.0, 0.0};
  constexpr int kSeeds = 40;
  for (int level = 0; level < 2; ++level) {
    for (int seed = 0; seed < kSeeds; ++seed) {
      SceneOptions options;
      options.seed = 300 + seed;
      options.imu_noise = true;
      options.sigma_position = level == 0 ? 1e-4 : 4e-4;
      const Scene scene = makeScene(options);
      const ApproximateAlignment result = approximateScaleGravityTranslation(scene.input());
      ASSERT_TRUE(result.ok()) << seed << ": " << result.failure;
      scale[level] += std::pow(result.scale / options.scale - 1.0, 2) / kSeeds;
      gravity[level] += (result.g_V - scene.g_V).squaredNorm() / kSeeds;
      translation[level] += (result.p_BC - options.p_BC).squaredNorm() / kSeeds;
    }
    std::printf("structure noise %.0e: scale %.4f, gravity %.4f m/s^2, translation %.4f m (RMS)\n",
                level == 0 ? 1e-4 : 4e-4, std::sqrt(scale[level]), std::sqrt(gravity[level]),
                std::sqrt(translation[level]));
  }
  EXPECT_LT(std::sqrt(scale[0]), 0.002);
  EXPECT_LT(std::sqrt(gravity[0]), 0.01);
  EXPECT_LT(std::sqrt(translation[0]), 0.01);
  for (const double* variance : {scale, translation}) {
    EXPECT_GT(variance[1], 4.0 * variance[0]);
    EXPECT_LT(variance[1], 25.0 * variance[0]) << "four times the noise";
  }
}

TEST(Refinement, WeightedIsConsistentAndBetterThanPlain) {
  const int seeds = 60;
  const Spread plain = monteCarlo(false, seeds), weighted = monteCarlo(true, seeds);
  // Mean of 60 chi-square variables of 9 degrees: sigma 0.55; the inflation by chi^2 pulls it below 9.
  EXPECT_GT(weighted.nees, 6.5);
  EXPECT_LT(weighted.nees, 10.7);
  EXPECT_LT(weighted.rms_scale, 0.5 * plain.rms_scale);
  EXPECT_LT(weighted.rms_p_BC, 0.5 * plain.rms_p_BC);
  EXPECT_LT(std::abs(weighted.mean_scale), 3.5 * weighted.rms_scale / std::sqrt(seeds));
}

TEST(Refinement, TranslationPriorHoldsWhatTheMotionDoesNotTell) {
  SceneOptions options;
  options.imu_noise = true;
  options.sigma_position = 1e-3;
  const Scene scene = makeScene(options, SineTrajectory(1.0, 0.002));  // nearly no rotation
  ApproximateAlignment start = approximateScaleGravityTranslation(scene.input());
  start.failure.clear();
  AlignmentOptions alignment_options;
  alignment_options.noise.emplace();
  alignment_options.noise->sigma_position = 1e-3;
  alignment_options.noise->sigma_p_BC = 0.02;
  alignment_options.noise->prior_p_BC = options.p_BC + Vector3d(0.01, -0.01, 0.01);
  start.p_CB.setZero();
  const Alignment result = refineWithAccelerometerBias(scene.input(), start, alignment_options);
  ASSERT_TRUE(result.ok()) << result.failure;
  EXPECT_LT((result.p_BC - alignment_options.noise->prior_p_BC).norm(), 0.005);
  EXPECT_NEAR(result.sigma_p_BC.maxCoeff(), 0.02, 0.005);
  EXPECT_LT(std::abs(result.scale / options.scale - 1.0), 3.0 * result.sigma_scale);
}

TEST(Alignment, DegenerateMotionIsRefusedWithTheReason) {
  SceneOptions options;
  options.propagate = false;
  const auto reason = [&](Scene scene) { return approximateScaleGravityTranslation(scene.input()).failure; };

  Scene standstill = makeScene(options, SineTrajectory(0.0, 0.0));
  EXPECT_NE(reason(standstill).find("stands still"), std::string::npos) << reason(standstill);

  Scene constant_velocity = standstill;
  for (std::size_t k = 0; k < constant_velocity.keyframes.size(); ++k)
    constant_velocity.keyframes[k].p_VC += 0.1 * static_cast<double>(k) * Vector3d(1.0, 2.0, -0.3);
  EXPECT_NE(reason(constant_velocity).find("constant velocity"), std::string::npos)
      << reason(constant_velocity);

  Scene no_rotation = makeScene(options, SineTrajectory(1.0, 0.0));
  EXPECT_NE(reason(no_rotation).find("does not rotate"), std::string::npos) << reason(no_rotation);

  // Noise must not turn a standstill or a constant velocity into a scale.
  for (Scene scene : {standstill, constant_velocity}) {
    std::mt19937 random(3);
    std::normal_distribution<double> gauss(0.0, 1e-3);
    for (AlignmentKeyframe& keyframe : scene.keyframes)
      keyframe.p_VC += Vector3d(gauss(random), gauss(random), gauss(random));
    EXPECT_FALSE(reason(scene).empty());
  }
}

TEST(Alignment, BadInputIsRefusedWithTheReason) {
  const Scene good = makeScene(SceneOptions());
  const auto reason = [](const Scene& scene) {
    return approximateScaleGravityTranslation(scene.input()).failure;
  };
  ASSERT_TRUE(reason(good).empty()) << reason(good);

  Scene few = good;
  few.keyframes.resize(4);
  few.preintegrations.erase(few.preintegrations.begin() + 3, few.preintegrations.end());
  EXPECT_NE(reason(few).find("at least 5 keyframes"), std::string::npos);

  Scene missing = good;
  missing.preintegrations.pop_back();
  EXPECT_NE(reason(missing).find("preintegrations"), std::string::npos);

  Scene shifted = good;
  shifted.keyframes[3].stamp += fromSeconds(0.05);
  EXPECT_NE(reason(shifted).find("apart"), std::string::npos);

  Scene broken = good;
  broken.keyframes[3].p_VC.x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_NE(reason(broken).find("not finite"), std::string::npos);

  Scene mixed = good;
  ImuBias bias;
  bias.accelerometer = Vector3d(0.1, 0.0, 0.0);
  mixed.preintegrations[2].repropagate(bias);
  EXPECT_NE(reason(mixed).find("bias"), std::string::npos);
}

TEST(AlignmentEquations, PoseJacobianMatchesDifferences) {
  const Scene scene = makeScene(SceneOptions());
  const Vector3d p_CB(0.1, -0.2, 0.05), bias(0.2, 0.1, -0.3);
  const double scale = 2.0;
  const auto residual = [&](const Scene& s) {
    const AlignmentEquations e = alignmentEquations(s.input());
    return (e.lambda * scale + e.phi * p_CB + e.psi * bias - e.gamma).eval();
  };
  const Eigen::MatrixXd J = poseJacobian(scene.input(), scale, p_CB, bias);
  const double h = 1e-5;
  for (int k = 0; k < 5; ++k) {
    for (int c = 0; c < 6; ++c) {
      Scene plus = scene, minus = scene;
      Vector3d d = Vector3d::Zero();
      d(c % 3) = h;
      if (c < 3) {
        plus.keyframes[k].p_VC += d;
        minus.keyframes[k].p_VC -= d;
      } else {
        plus.keyframes[k].R_VC = plus.keyframes[k].R_VC * expSo3(d);
        minus.keyframes[k].R_VC = minus.keyframes[k].R_VC * expSo3((-d).eval());
      }
      const Eigen::VectorXd numeric = (residual(plus) - residual(minus)) / (2.0 * h);
      EXPECT_LT((J.col(6 * k + c) - numeric).norm(), 1e-6 * (1.0 + numeric.norm()))
          << "pose " << k << " col " << c;
    }
  }
}

TEST(KeyframeVelocities, ExactToRounding) {
  SceneOptions options;
  options.propagate = true;
  options.accelerometer_bias = Vector3d(0.1, 0.05, -0.1);
  const Scene scene = makeScene(options);
  const Alignment alignment = refineWithAccelerometerBias(
      scene.input(), approximateScaleGravityTranslation(scene.input()), AlignmentOptions());
  ASSERT_TRUE(alignment.ok()) << alignment.failure;
  const std::vector<Vector3d> velocities = keyframeVelocities(scene.input(), alignment);
  ASSERT_EQ(velocities.size(), scene.velocities_V.size());
  for (std::size_t k = 0; k < velocities.size(); ++k)
    EXPECT_LT((velocities[k] - scene.velocities_V[k]).norm(), 1e-7) << k;
}

TEST(KeyframeVelocities, MeanOfBothNeighboursBeatsOne) {
  SceneOptions options;
  options.sigma_position = 1e-3;
  const Scene scene = makeScene(options);
  Alignment truth;
  truth.scale = options.scale;
  truth.g_V = scene.g_V;
  truth.p_CB = -(scene.R_BC.conjugate() * options.p_BC);
  const std::vector<Vector3d> velocities = keyframeVelocities(scene.input(), truth);
  double squared = 0.0;
  const std::size_t inner = velocities.size() - 2;
  for (std::size_t k = 1; k <= inner; ++k)
    squared += (velocities[k] - scene.velocities_V[k]).squaredNorm() / (3.0 * inner);
  // Central difference: sqrt(2) sigma / (2 dt); a one-sided one is twice that.
  const double central = std::sqrt(2.0) * options.scale * options.sigma_position / (2.0 * options.interval);
  EXPECT_NEAR(std::sqrt(squared), central, 0.35 * central);
}

}  // namespace
}  // namespace autocal_vio
