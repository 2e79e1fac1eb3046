// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

namespace tarsier::sfm {

// Additional damping of single variables in Levenberg-Marquardt's method. Where a step fails, it is
// often because of a few variables: a loose image of a large model, say. Damping all variables more
// would hold up all of them. So where most of the rise of the cost is at few variables, only these
// are damped, until steps succeed again.
class LocalDamping {
 public:
  explicit LocalDamping(int variables);

  // Additional damping of a variable, 0 to 10, as a share of the diagonal of the equations.
  [[nodiscard]] double of(int variable) const;

  // To be called for a step that has failed. `rises`: for each variable, how much the cost has
  // risen because of it. Raises the damping of the variables that make up nine tenths of the rise.
  // False, and nothing is changed, where these are more than a twentieth of all variables or are
  // damped completely: then the damping of all variables has to be raised.
  bool raise(const std::vector<double>& rises);

  // To be called for a step that has succeeded: lowers all additional damping.
  void lower();

 private:
  std::vector<double> damping_;
};

}  // namespace tarsier::sfm
