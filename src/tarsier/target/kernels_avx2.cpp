// SPDX-License-Identifier: MIT
#include "tarsier/target/kernels.h"

#if defined(__x86_64__)
#define TARSIER_TARGET_KERNELS kernels_avx2
#include "tarsier/target/kernels.inl"
#else
const tarsier::target::Kernels* tarsier::target::kernels_avx2() { return nullptr; }
#endif
