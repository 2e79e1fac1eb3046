// SPDX-License-Identifier: MIT
#define TARSIER_VECTOR_BYTES 16
#define TARSIER_HAAR haar_baseline
#include "tarsier/face/detect/haar_kernels.inl"
