// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

// Common parts of the fuzzing targets. A target passes bytes to one reader of untrusted input, and
// its result to the code that uses it. A reader may throw only the exceptions of core/errors.h. Any
// other exception, a crash, a leak, or a use of minutes or gigabytes is a finding. The same targets
// run under libFuzzer (driver.cpp, clang) and as tests over the committed inputs (replay.cpp, any
// compiler).
namespace tarsier::fuzz {

using Bytes = std::span<const std::uint8_t>;

// How libFuzzer mutates inputs: as bytes, or as a JSON tree that stays well-formed.
enum class Form { kBytes, kJson };

struct Target {
  std::string_view name;
  Form form = Form::kBytes;
  void (*run)(Bytes input) = nullptr;
};

// All linked targets, in no particular order.
[[nodiscard]] std::vector<Target>& targets();
// The target of that name; nullptr if there is none.
[[nodiscard]] const Target* find_target(std::string_view name);

// Whether the reader accepted the input (false: it threw a tarsier::Error). Other exceptions are
// not caught.
bool run_target(const Target& target, Bytes input);

// A folder of this process in memory (/dev/shm, or $TARSIER_FUZZ_TMP), removed at exit.
[[nodiscard]] const std::string& scratch_folder();
// Writes a file of that name with these bytes to the folder; returns its path.
std::string file_of(Bytes bytes, std::string_view name);
std::string file_of(std::string_view text, std::string_view name);

[[nodiscard]] inline std::string_view text_of(Bytes bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

// Splits an input that represents several files at lines "%%%" into `count` parts; the last ones
// may be empty.
[[nodiscard]] std::vector<std::string_view> parts_of(Bytes bytes, std::size_t count);

// Pieces of sizes 1..`max_size` for a parser. The sizes depend on the bytes, so that a finding can
// be reproduced.
class Pieces {
 public:
  Pieces(Bytes bytes, std::size_t max_size);
  [[nodiscard]] Bytes next();  // empty at the end

 private:
  Bytes rest_;
  std::size_t max_size_;
  std::uint32_t state_;
};

// Throws std::logic_error if the target found an impossible result.
void expect(bool holds, const char* what);

struct Registration {
  explicit Registration(const Target& target) { targets().push_back(target); }
};

}  // namespace tarsier::fuzz

#define TARSIER_FUZZ_TARGET(NAME, FORM)                           \
  static void fuzz_##NAME(::tarsier::fuzz::Bytes input);          \
  static const ::tarsier::fuzz::Registration registration_##NAME( \
      {#NAME, ::tarsier::fuzz::Form::FORM, fuzz_##NAME});         \
  static void fuzz_##NAME(::tarsier::fuzz::Bytes input)
