// SPDX-License-Identifier: MIT
#define TARSIER_TARGET_KERNELS kernels_baseline
#include "tarsier/planar/image_targets/kernels.inl"
