// SPDX-License-Identifier: MIT
#define TARSIER_VECTOR_BYTES 16
#define TARSIER_SIFT sift_baseline
#include "tarsier/sfm/features/sift_kernels.inl"
