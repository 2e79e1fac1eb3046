// SPDX-License-Identifier: MIT
#include "tarsier/face/detect/haar_kernels.h"

#if defined(__x86_64__)
#define TARSIER_VECTOR_BYTES 64
#define TARSIER_HAAR haar_avx512
#include "tarsier/face/detect/haar_kernels.inl"
#else
const tarsier::face::HaarKernels* tarsier::face::haar_avx512() { return nullptr; }
#endif
