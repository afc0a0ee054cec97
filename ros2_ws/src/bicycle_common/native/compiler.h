// Words of the compiler that our C++ needs.
#pragma once

// A function compiled for several kinds of vector instructions; the processor's widest are taken.
#if defined(__x86_64__) && defined(__gnu_linux__)
#define WIDEST __attribute__((target_clones("avx512f", "avx2", "default")))
#else
#define WIDEST
#endif

#define ALWAYS static inline __attribute__((always_inline))
