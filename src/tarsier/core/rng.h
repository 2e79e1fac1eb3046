// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <cstdint>

namespace tarsier {

// Seeded pseudo-random numbers, identical on every machine and standard library: xoshiro256**
// (Blackman and Vigna, "Scrambled linear pseudorandom number generators", ACM TOMS 2021), seeded
// through splitmix64. Not for secrets. A value type: copy it to replay the sequence; fork() it to
// give each item of parallel work its own generator.
class Rng {
 public:
  using result_type = std::uint64_t;

  explicit Rng(std::uint64_t seed);

  static constexpr result_type min() { return 0; }
  static constexpr result_type max() { return ~result_type{0}; }
  result_type operator()();

  double uniform();                         // in [0, 1)
  double uniform(double low, double high);  // in [low, high)
  double normal();                          // mean 0, standard deviation 1
  double normal(double mean, double sigma);
  int integer(int low, int high);  // in [low, high], both ends included; requires low <= high

  // An independent generator. It depends only on the seed of this one and on `stream`, not on the
  // count of numbers drawn.
  [[nodiscard]] Rng fork(std::uint64_t stream) const;

 private:
  std::uint64_t seed_;
  std::array<std::uint64_t, 4> state_{};
  double spare_ = 0;
  bool has_spare_ = false;
};

}  // namespace tarsier
