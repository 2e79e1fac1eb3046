// SPDX-License-Identifier: MIT
#include "tarsier/core/rng.h"

#include "tarsier/core/require.h"

#include <bit>
#include <cmath>

namespace tarsier {
namespace {

std::uint64_t splitmix64(std::uint64_t& x) {
  x += 0x9e3779b97f4a7c15U;
  std::uint64_t z = x;
  z = (z ^ (z >> 30U)) * 0xbf58476d1ce4e5b9U;
  z = (z ^ (z >> 27U)) * 0x94d049bb133111ebU;
  return z ^ (z >> 31U);
}

}  // namespace

Rng::Rng(std::uint64_t seed) : seed_(seed) {
  for (std::uint64_t& word : state_) word = splitmix64(seed);
}

Rng::result_type Rng::operator()() {
  const std::uint64_t result = std::rotl(state_[1] * 5, 7) * 9;
  const std::uint64_t t = state_[1] << 17U;
  state_[2] ^= state_[0];
  state_[3] ^= state_[1];
  state_[1] ^= state_[2];
  state_[0] ^= state_[3];
  state_[2] ^= t;
  state_[3] = std::rotl(state_[3], 45);
  return result;
}

double Rng::uniform() { return static_cast<double>((*this)() >> 11U) * 0x1.0p-53; }

double Rng::uniform(double low, double high) { return low + (high - low) * uniform(); }

double Rng::normal() {  // polar method of Marsaglia
  if (has_spare_) {
    has_spare_ = false;
    return spare_;
  }
  double u = 0;
  double v = 0;
  double s = 0;
  do {
    u = uniform(-1, 1);
    v = uniform(-1, 1);
    s = u * u + v * v;
  } while (s >= 1 || s == 0);
  const double scale = std::sqrt(-2 * std::log(s) / s);
  spare_ = v * scale;
  has_spare_ = true;
  return u * scale;
}

double Rng::normal(double mean, double sigma) { return mean + sigma * normal(); }

int Rng::integer(int low, int high) {
  TARSIER_REQUIRE(low <= high, "got [{}, {}]", low, high);
  const auto range = static_cast<std::uint64_t>(static_cast<std::int64_t>(high) - low) + 1;
  const std::uint64_t limit = max() - max() % range;  // reject the incomplete last range
  std::uint64_t x = (*this)();
  while (x >= limit) x = (*this)();
  return static_cast<int>(low + static_cast<std::int64_t>(x % range));
}

Rng Rng::fork(std::uint64_t stream) const {
  std::uint64_t x = seed_ ^ 0x6a09e667f3bcc909U;
  const std::uint64_t a = splitmix64(x);
  std::uint64_t y = stream;
  return Rng(a ^ splitmix64(y));
}

}  // namespace tarsier
