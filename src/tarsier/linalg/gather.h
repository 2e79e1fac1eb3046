// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/linalg/network.h"

#include <cstddef>
#include <vector>

// A map with a border of zeros, and its patches as the columns of a matrix: what turns a
// convolution into a matrix product. Internal to this module.
namespace tarsier::linalg {

struct Padded {
  const float* data = nullptr;
  int height = 0;
  int width = 0;
};

// Copies `input` into `buffer` with the layer's border, and behind the map kPanel zeros that
// kernels may read.
Padded pad(const Layer& layer, const float* input, Shape from, std::vector<float>& buffer);

// Where the weights of one output channel find their inputs, for a layer of stride 1: output pixel
// (y, x) reads data[y * source.width + x + offset]. Output pixels may thus be counted along the
// rows of the padded map, and nothing needs to be gathered; those between the rows mean nothing.
void window_offsets(const Layer& layer, const Padded& source, std::vector<std::ptrdiff_t>& offsets);

// One convolution, for networks that are no chains (residual.h): `output` gets the map, of shape
// layer.output(from). Throws std::invalid_argument for a maximum.
void run_layer(const Layer& layer, const float* input, Shape from, Workspace& workspace,
               std::vector<float>& output, bool parallel = false);

// Columns begin .. begin + count of the patch matrix (depth x output pixels), written with row
// stride `stride`; columns count .. stride are set to zero.
void gather(const Layer& layer, const Padded& source, Shape to, int begin, int count, int stride,
            float* columns);

// The transpose of gather(): adds columns back onto the padded map.
void scatter(const Layer& layer, const float* columns, int stride, Shape to, int begin, int count,
             float* padded, int padded_height, int padded_width);

}  // namespace tarsier::linalg
