// SPDX-License-Identifier: MIT
#include "tarsier/sfm/bundle/local_damping.h"

#include "tarsier/core/at.h"

#include <algorithm>

namespace tarsier::sfm {
namespace {

constexpr double kShareOfRise = 0.9;
constexpr double kMaxShareOfVariables = 0.05;
constexpr double kFirstLocalDamping = 1e-4;
constexpr double kLocalFactor = 10;  // by which damping grows and is lowered
constexpr double kCompleteDamping = 1;

}  // namespace

LocalDamping::LocalDamping(int variables) : damping_(at(variables), 0) {}

double LocalDamping::of(int variable) const { return damping_[at(variable)]; }

bool LocalDamping::raise(const std::vector<double>& rises) {
  std::vector<int> raised;
  double sum = 0;
  for (std::size_t v = 0; v < rises.size(); ++v) {
    if (!(rises[v] > 0)) continue;
    raised.push_back(static_cast<int>(v));
    sum += rises[v];
  }
  std::sort(raised.begin(), raised.end(), [&](int a, int b) {
    return rises[at(a)] != rises[at(b)] ? rises[at(a)] > rises[at(b)] : a < b;
  });
  std::size_t count = 0;
  for (double part = 0; count < raised.size() && part < kShareOfRise * sum; ++count)
    part += rises[at(raised[count])];
  if (static_cast<double>(count) > kMaxShareOfVariables * static_cast<double>(damping_.size()))
    return false;
  bool is_changed = false;
  for (std::size_t k = 0; k < count; ++k) {
    double& damping = damping_[at(raised[k])];
    if (damping >= kCompleteDamping) continue;
    damping = std::max(kFirstLocalDamping, kLocalFactor * damping);
    is_changed = true;
  }
  return is_changed;
}

void LocalDamping::lower() {
  for (double& damping : damping_) damping /= kLocalFactor;
}

}  // namespace tarsier::sfm
