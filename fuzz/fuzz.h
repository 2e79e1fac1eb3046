// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

// What the fuzzing targets share. A target hands bytes to one reader of untrusted input, and to
// what works on its result. Of exceptions only those of core/errors.h may come out of a reader; all
// others, a crash, a leak, minutes or gigabytes are findings. The same targets run under libFuzzer
// (driver.cpp, clang) and as tests over the committed inputs (replay.cpp, any compiler).
namespace tarsier::fuzz {

using Bytes = std::span<const std::uint8_t>;

// How libFuzzer changes inputs: as bytes, or as a tree of JSON that stays well-formed.
enum class Form { kBytes, kJson };

struct Target {
  std::string_view name;
  Form form = Form::kBytes;
  void (*run)(Bytes input) = nullptr;
};

// All that are linked in, in no order.
[[nodiscard]] std::vector<Target>& targets();
// The one of that name; nullptr where there is none.
[[nodiscard]] const Target* find_target(std::string_view name);

// Whether the reader took the input (false: it threw a tarsier::Error). Other exceptions go
// through.
bool run_target(const Target& target, Bytes input);

// A folder of this process in memory (/dev/shm, or $TARSIER_FUZZ_TMP), removed at its end.
[[nodiscard]] const std::string& scratch_folder();
// A file of that name there with these bytes; its path.
std::string file_of(Bytes bytes, std::string_view name);
std::string file_of(std::string_view text, std::string_view name);

[[nodiscard]] inline std::string_view text_of(Bytes bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

// The parts of an input that stands for several files, between lines "%%%"; `count` of them, the
// last ones perhaps empty.
[[nodiscard]] std::vector<std::string_view> parts_of(Bytes bytes, std::size_t count);

// Sizes 1..`most` of pieces to feed a parser with; from the bytes themselves, so that a find can be
// played again.
class Pieces {
 public:
  Pieces(Bytes bytes, std::size_t most);
  [[nodiscard]] Bytes next();  // empty at the end

 private:
  Bytes rest_;
  std::size_t most_;
  std::uint32_t state_;
};

// Throws std::logic_error: the target found a result that cannot be.
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
