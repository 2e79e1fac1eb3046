// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/linalg/network.h"

#include <cstddef>
#include <vector>

// A map with zero padding, and its patches as the columns of a matrix, which turns a convolution
// into a matrix product. Internal to this module.
namespace tarsier::linalg {

struct Padded {
  const float* data = nullptr;
  int height = 0;
  int width = 0;
};

// Copies `input` into `buffer` with the layer's padding, followed by kPanel zeros that kernels may
// read.
Padded pad(const Layer& layer, const float* input, Shape from, std::vector<float>& buffer);

// For a layer of stride 1: the input offset of each weight of an output channel. Output pixel (y,
// x) reads data[y * source.width + x + offset]. Output pixels can therefore be counted along the
// rows of the padded map without gathering; those between the rows are meaningless.
void window_offsets(const Layer& layer, const Padded& source, std::vector<std::ptrdiff_t>& offsets);

// One convolution, for networks that are not chains (residual.h). `output` receives the map, of
// shape layer.output(from). Throws std::invalid_argument for a maximum layer.
void run_layer(const Layer& layer, const float* input, Shape from, Workspace& workspace,
               std::vector<float>& output, bool parallel = false);

// Writes columns begin .. begin + count of the patch matrix (depth x output pixels), with row
// stride `stride`; columns count .. stride are set to zero.
void gather(const Layer& layer, const Padded& source, Shape to, int begin, int count, int stride,
            float* columns);

// The transpose of gather(): adds the columns to the padded map.
void scatter(const Layer& layer, const float* columns, int stride, Shape to, int begin, int count,
             float* padded, int padded_height, int padded_width);

}  // namespace tarsier::linalg
