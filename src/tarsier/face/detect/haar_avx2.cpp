// SPDX-License-Identifier: MIT
#include "tarsier/face/detect/haar_kernels.h"

#if defined(__x86_64__)
#define TARSIER_VECTOR_BYTES 32
#define TARSIER_HAAR haar_avx2
#include "tarsier/face/detect/haar_kernels.inl"
#else
const tarsier::face::HaarKernels* tarsier::face::haar_avx2() { return nullptr; }
#endif
