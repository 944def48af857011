#include "autocal_vio/factors/marginal_prior.h"

#include <utility>

#include "autocal_vio/geometry/so3.h"

namespace autocal_vio {
namespace {

using ConstVector3 = Eigen::Map<const Eigen::Vector3d>;
using ConstQuaternion = Eigen::Map<const Eigen::Quaterniond>;

bool isPose(const PriorState& state) {
  return state.size() == 7;
}
bool isMotion(const PriorState& state) {
  return state.size() == 9;
}

}  // namespace

MarginalPrior::MarginalPrior(std::vector<PriorState> points, Eigen::MatrixXd jacobian,
                             Eigen::VectorXd residual)
    : points_(std::move(points)), jacobian_(std::move(jacobian)), residual_(std::move(residual)) {
  for (const PriorState& point : points_)
    if (isPose(point)) {
      centre_ = point.head<3>();
      break;
    }
  // dtheta = R^T phi, dp = rho - [p - c] phi, dv = nu - [v] phi.
  int column = 0;
  for (std::size_t i = 0; i < points_.size(); ++i) {
    const PriorState& point = points_[i];
    if (isPose(point)) {
      const Eigen::Matrix3d R = ConstQuaternion(point.data() + 3).toRotationMatrix();
      auto by_rotation = jacobian_.middleCols<3>(column + 3);
      by_rotation = (by_rotation * R.transpose()).eval();
      by_rotation.noalias() -=
          jacobian_.middleCols<3>(column) * skew(Eigen::Vector3d(point.head<3>() - centre_));
      if (i + 1 < points_.size() && isMotion(points_[i + 1]))
        by_rotation.noalias() -=
            jacobian_.middleCols<3>(column + 6) * skew(Eigen::Vector3d(points_[i + 1].head<3>()));
    }
    column += tangentSizeOf(static_cast<int>(point.size()));
  }
}

MarginalPrior MarginalPrior::at(const std::vector<PriorState>& states) const {
  std::vector<const double*> pointers;
  for (const PriorState& state : states) pointers.push_back(state.data());
  Eigen::VectorXd error(jacobian_.cols());
  errorOf(pointers.data(), error);
  MarginalPrior moved = *this;
  moved.points_ = states;
  moved.residual_.noalias() += jacobian_ * error;
  return moved;
}

void MarginalPrior::errorOf(double const* const* states, Eigen::Ref<Eigen::VectorXd> error) const {
  int column = 0;
  Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();  // R R0^T of the pose before
  for (std::size_t i = 0; i < points_.size(); ++i) {
    const PriorState& x0 = points_[i];
    const double* x = states[i];
    const int tangent = tangentSizeOf(static_cast<int>(x0.size()));
    auto e = error.segment(column, tangent);
    if (isPose(x0)) {
      const Eigen::Quaterniond q = ConstQuaternion(x + 3) * ConstQuaternion(x0.data() + 3).conjugate();
      turn = q.toRotationMatrix();
      e.head<3>() = (ConstVector3(x) - centre_) - turn * (x0.head<3>() - centre_);
      e.tail<3>() = logSo3(q);
    } else if (x0.size() == 4) {
      e = logSo3(ConstQuaternion(x0.data()).conjugate() * ConstQuaternion(x));
    } else {
      e = Eigen::Map<const Eigen::VectorXd>(x, tangent) - x0;
      if (isMotion(x0)) e.head<3>() = ConstVector3(x) - turn * x0.head<3>();
    }
    column += tangent;
  }
}

}  // namespace autocal_vio
