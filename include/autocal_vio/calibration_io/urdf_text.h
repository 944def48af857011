// Changes the origin of one joint in the text of a URDF and leaves every other byte alone.
#pragma once

#include <optional>
#include <string>

#include "autocal_vio/geometry/transform.h"

namespace autocal_vio {

/// `xml` with <origin xyz rpy> of the joint `joint` (a child of <robot>) replaced by T_parent_child; written where the
/// joint has none. Comments, formatting and quotes stay. Nothing where there is no such joint. `xml` must be well formed.
std::optional<std::string> replaceJointOrigin(const std::string& xml, const std::string& joint,
                                              const Transform& T_parent_child);

}  // namespace autocal_vio
