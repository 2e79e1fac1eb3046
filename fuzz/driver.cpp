// SPDX-License-Identifier: MIT
// libFuzzer's entry points: TARSIER_FUZZ=NAME fuzz_AREA [flags of libFuzzer] [folders].
#include "fuzz.h"
#include "json_mutator.h"
#include <cstdio>
#include <cstdlib>

namespace {
const tarsier::fuzz::Target* target = nullptr;
}

extern "C" std::size_t LLVMFuzzerMutate(std::uint8_t* data, std::size_t size, std::size_t max_size);

extern "C" int LLVMFuzzerInitialize(int*, char***) {
  const char* name = std::getenv("TARSIER_FUZZ");
  target = tarsier::fuzz::find_target(name != nullptr ? name : "");
  if (target != nullptr) return 0;
  std::fprintf(stderr, "TARSIER_FUZZ names none of:");
  for (const auto& known : tarsier::fuzz::targets())
    std::fprintf(stderr, " %s", std::string(known.name).c_str());
  std::fprintf(stderr, "\n");
  std::exit(2);
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  tarsier::fuzz::run_target(*target, {data, size});
  return 0;
}

extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size,
                                               std::size_t max_size, unsigned seed) {
  if (target->form == tarsier::fuzz::Form::kJson)
    return tarsier::fuzz::mutate_json(data, size, max_size, seed, LLVMFuzzerMutate);
  return LLVMFuzzerMutate(data, size, max_size);
}
