// SPDX-License-Identifier: MIT
#define TARSIER_VECTOR_BYTES 16
#define TARSIER_PATCH_KERNELS patch_kernels_baseline
#include "tarsier/sfm/dense/patch_kernels.inl"
