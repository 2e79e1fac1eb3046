// SPDX-License-Identifier: MIT
#include "tarsier/sfm/bundle/schur_kernel.h"

#if defined(__AVX2__)
#include <cstring>

namespace tarsier::sfm {
namespace {

using Four = double __attribute__((vector_size(32)));

Four load(const double* from) {
  Four result;
  std::memcpy(&result, from, sizeof(result));
  return result;
}

// Two columns of a block are three vectors of four numbers: rows 0 to 3 of the first column; its
// rows 4 and 5, and rows 0 and 1 of the second; rows 2 to 5 of the second. Multiplications and
// additions are not contracted and have the order of the baseline.
void subtract(const double* scaled, const PoseBlock* blocks, int count) {
  Four factors[3][3][3];  // [pair of columns 2c, 2c + 1 of the block][vector][term of the product]
  for (int c = 0; c < 3; ++c) {
    for (int j = 0; j < 3; ++j) {
      const double first = scaled[6 * j + 2 * c];
      const double second = scaled[6 * j + 2 * c + 1];
      factors[c][0][j] = Four{first, first, first, first};
      factors[c][1][j] = Four{first, first, second, second};
      factors[c][2][j] = Four{second, second, second, second};
    }
  }
  for (int k = 0; k < count; ++k) {
    const double* mixed = blocks[k].mixed;
    double* block = blocks[k].block;
    Four rows[3][3];  // [vector][term]
    for (int j = 0; j < 3; ++j) {
      const double* column = mixed + 6 * j;
      rows[0][j] = load(column);
      rows[1][j] = Four{column[4], column[5], column[0], column[1]};
      rows[2][j] = load(column + 2);
    }
    for (int c = 0; c < 3; ++c) {
      for (int v = 0; v < 3; ++v) {
        double* numbers = block + 12 * c + 4 * v;
        Four product = rows[v][0] * factors[c][v][0];
        product = product + rows[v][1] * factors[c][v][1];
        product = product + rows[v][2] * factors[c][v][2];
        const Four left = load(numbers) - product;
        std::memcpy(numbers, &left, sizeof(left));
      }
    }
  }
}

}  // namespace

SubtractProducts subtract_products_avx2() { return subtract; }

}  // namespace tarsier::sfm
#else
tarsier::sfm::SubtractProducts tarsier::sfm::subtract_products_avx2() { return nullptr; }
#endif
