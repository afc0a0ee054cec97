// Matrix products for one thread, tile by tile in registers, and memory for them.
#pragma once

#include <cstddef>
#include <memory>
#include <new>
#include <type_traits>

namespace {

#if defined(__AVX512F__)
constexpr int LANES = 16, ACROSS = 4;
#else
constexpr int LANES = 8, ACROSS = 2;
#endif
constexpr int DOWN = 6;    // rows of a tile: with ACROSS vectors each they fill the registers

typedef float Vector __attribute__((vector_size(LANES * sizeof(float)), aligned(4)));

inline Vector load(const float* from) { return *reinterpret_cast<const Vector*>(from); }
inline void store(float* to, Vector value) { *reinterpret_cast<Vector*>(to) = value; }
inline Vector all(float value) { return value - Vector{}; }
inline Vector positive(Vector value) { return value > 0.0f ? value : Vector{}; }

typedef int Whole __attribute__((vector_size(LANES * sizeof(int))));

// Numbers of a (index below LANES) and of b (LANES and more).
inline Vector chosen(Vector a, Vector b, Whole index) {
#if defined(__clang__)
  Vector result;
  for (int i = 0; i < LANES; i++) result[i] = index[i] < LANES ? a[index[i]] : b[index[i] - LANES];
  return result;
#else
  return __builtin_shuffle(a, b, index);
#endif
}

template <int STEP>
inline void exchange(Vector* row) {
  Whole low, high;
  for (int j = 0; j < LANES; j++) {
    low[j] = j & STEP ? LANES + j - STEP : j;
    high[j] = j & STEP ? LANES + j : j + STEP;
  }
#pragma GCC unroll 16
  for (int i = 0; i < LANES; i++) {
    if (i & STEP) continue;
    const Vector a = row[i], b = row[i + STEP];
    row[i] = chosen(a, b, low);
    row[i + STEP] = chosen(a, b, high);
  }
}

// LANES x LANES numbers, rows `down` and `across` apart: to[j][i] = from[i][j].
inline void transpose(const float* from, size_t down, float* to, size_t across) {
  Vector row[LANES];
#pragma GCC unroll 16
  for (int i = 0; i < LANES; i++) row[i] = load(from + i * down);
  exchange<1>(row);
  exchange<2>(row);
  exchange<4>(row);
  if (LANES > 8) exchange<LANES / 2>(row);
#pragma GCC unroll 16
  for (int i = 0; i < LANES; i++) store(to + i * across, row[i]);
}

// A(m, k) = a[m * down + k * deep]; B's row k starts at b + k * width.
struct Factors {
  const float* a;
  size_t down, deep;
  const float* b;
  size_t width;
  int depth;
};

template <int M, int W, class First, class Last>
inline void tile(const Factors& f, int row, int column, First first, Last last) {
  Vector sum[M][W];
  for (int m = 0; m < M; m++)
    for (int w = 0; w < W; w++) sum[m][w] = first(row + m, column + w * LANES);
  const float* a = f.a + row * f.down;
  const float* b = f.b + column;
  for (int k = 0; k < f.depth; k++, a += f.deep, b += f.width) {
    Vector right[W];
    for (int w = 0; w < W; w++) right[w] = load(b + w * LANES);
    for (int m = 0; m < M; m++)
      for (int w = 0; w < W; w++) sum[m][w] += all(a[m * f.down]) * right[w];
  }
  for (int m = 0; m < M; m++)
    for (int w = 0; w < W; w++) last(row + m, column + w * LANES, sum[m][w]);
}

template <int W, class First, class Last>
void strip(const Factors& f, int rows, int column, First first, Last last) {
  int row = 0;
  for (; row + DOWN <= rows; row += DOWN) tile<DOWN, W>(f, row, column, first, last);
  switch (rows - row) {
    case 5: tile<5, W>(f, row, column, first, last); break;
    case 4: tile<4, W>(f, row, column, first, last); break;
    case 3: tile<3, W>(f, row, column, first, last); break;
    case 2: tile<2, W>(f, row, column, first, last); break;
    case 1: tile<1, W>(f, row, column, first, last); break;
  }
}

// first(row, column) starts the sum of LANES columns; last(row, column, sum) takes it.
template <class First, class Last>
void product(const Factors& f, int rows, int columns, First first, Last last) {
  int column = 0;
  auto take = [&](auto width) {
    strip<width.value>(f, rows, column, first, last);
    column += width.value * LANES;
  };
  using One = std::integral_constant<int, 1>;
  using Two = std::integral_constant<int, 2>;
  using Three = std::integral_constant<int, 3>;
  using Most = std::integral_constant<int, ACROSS>;
  for (;;) {  // one vector alone is half as quick, so five are three and two
    const int left = (columns - column + LANES - 1) / LANES;
    if (left <= 0) return;
    if (left >= ACROSS && left != ACROSS + 1)
      take(Most{});
    else if (ACROSS > 2 && (left == 5 || left == 3))
      take(Three{});
    else if (left >= 2)
      take(Two{});
    else
      take(One{});
  }
}

struct Memory {  // zeros that start on a cache line
  explicit Memory(size_t count) {
    data.reset(static_cast<float*>(::operator new[](count * sizeof(float), std::align_val_t(64))));
    for (size_t i = 0; i < count; i++) data[i] = 0.0f;
  }
  struct Free {
    void operator()(float* p) const { ::operator delete[](p, std::align_val_t(64)); }
  };
  std::unique_ptr<float[], Free> data;
  float* at(size_t offset) { return data.get() + offset; }
};

}  // namespace
