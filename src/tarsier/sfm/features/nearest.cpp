// SPDX-License-Identifier: MIT
#include "tarsier/sfm/features/nearest.h"

#include "tarsier/core/best_kernels.h"
#include "tarsier/core/cpu.h"
#include "tarsier/core/require.h"

#include <cstdlib>
#include <memory>
#include <new>

namespace tarsier::sfm {
namespace {

constexpr std::align_val_t kAlignment{64};

struct Free {
  void operator()(void* memory) const { ::operator delete(memory, kAlignment); }
};

}  // namespace

const NearestKernel& nearest_kernel() {
  if (simd_level() == SimdLevel::kDotProducts) return *nearest_dotprod();
  return best_kernels(nearest_baseline, nearest_avx2, nearest_vnni);
}

void find_nearest(const ByteRows& first, const ByteRows& second, Nearest* of_first,
                  Nearest* of_second) {
  TARSIER_REQUIRE(first.depth == second.depth && first.depth >= 1 && first.depth <= 4096,
                  "descriptors of {} and {} bytes", first.depth, second.depth);
  const NearestKernel& kernel = nearest_kernel();
  const std::size_t bytes = kernel.scratch_bytes(first.count, first.depth);
  const std::unique_ptr<void, Free> scratch(::operator new(bytes, kAlignment));
  kernel.run(first, second, scratch.get(), of_first, of_second);
}

}  // namespace tarsier::sfm
