#include "autocal_vio/estimator/sigma_inflation.h"

#include <algorithm>

#include "autocal_vio/geometry/so3.h"

namespace autocal_vio {
namespace {

constexpr double kStepTime = 1.0;       // [s] shorter steps do not see errors that change slowly
constexpr double kPriorSteps = 4.0;     // expected squares that speak for kPriorRatio
constexpr double kPriorRatio = 1.3;     // of variances: tracks of real images drift a little at least
constexpr double kLargestFactor = 4.0;  // times the least

}  // namespace

void SigmaInflation::add(TimeNs stamp, const Transform& T_BC, const Eigen::Matrix<double, 6, 6>& covariance) {
  const Sample now{stamp, T_BC, covariance.diagonal()};
  if (!started_) {
    started_ = true;
    last_ = now;
    return;
  }
  if (toSeconds(stamp - last_.stamp) < kStepTime) return;
  Eigen::Matrix<double, 6, 1> step;
  step << T_BC.translation - last_.T_BC.translation, logSo3(last_.T_BC.rotation.conjugate() * T_BC.rotation);
  for (int i = 0; i < 6; ++i) {
    // Held parts have no variance; a variance that grew was opened anew.
    const double gained = last_.variance(i) - now.variance(i);
    if (!(now.variance(i) > 0.0) || !(gained > 0.0)) continue;
    // Per variance before the step, so that the long first steps do not outweigh the rest.
    observed_ += step(i) * step(i) / last_.variance(i);
    expected_ += gained / last_.variance(i);
  }
  last_ = now;
}

double SigmaInflation::factor() const {
  const double ratio = (observed_ + kPriorSteps * kPriorRatio) / (expected_ + kPriorSteps);
  return least_ * std::clamp(ratio, 1.0, kLargestFactor);
}

}  // namespace autocal_vio
