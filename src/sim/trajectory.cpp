#include "autocal_vio/sim/trajectory.h"

namespace autocal_vio {

Eigen::AlignedBox3d positionBounds(const Trajectory& trajectory) {
  constexpr TimeNs kStep = kNsPerSecond / 20;
  Eigen::AlignedBox3d box(trajectory.at(trajectory.end()).T_WB.translation);
  for (TimeNs t = trajectory.begin(); t < trajectory.end(); t += kStep)
    box.extend(trajectory.at(t).T_WB.translation);
  return box;
}

}  // namespace autocal_vio
