// Forward and backward pass of a small perceptron, for one thread and batches of transitions.
//
// Activations lie feature by feature (a matrix of features x 64 transitions per chunk), so every
// product is a sum of scalar x row, each row 64 numbers wide: biases, relu, its slope and layer
// normalisation are then vector operations on the result while it is still in registers or near.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <new>
#include <vector>

#include "gemm.h"

namespace {

constexpr int CHUNK = 64;  // transitions that pass through the network together
constexpr int WIDE = CHUNK / LANES;
constexpr float NORM_EPSILON = 1e-5f;

}  // namespace

extern "C" {

struct Layer {  // weights out x in; the last four are null without layer normalisation
  int in, out;
  const float *weight, *bias;
  float *weight_slope, *bias_slope;
  const float *gain, *shift;
  float *gain_slope, *shift_slope;
};

}  // extern "C"

namespace {

struct Net {
  std::vector<Layer> layers;
  int join, observations;          // layer that the action enters at, -1 for none; numbers seen
  int batch, per, chunks;          // transitions; chunks of them; all chunks, the mirrored too
  std::vector<Memory> inputs;      // of every layer: chunks x in x 64
  std::vector<Memory> products;    // before normalisation: chunks x out x 64
  std::vector<Memory> statistics;  // mean and 1 / deviation: chunks x 2 x 64
  Memory output, rows, slope, next;

  static size_t widest(const std::vector<Layer>& layers) {
    size_t width = 0;
    for (const Layer& l : layers) width = std::max<size_t>(width, std::max(l.in, l.out));
    return width + LANES;
  }

  // With `sides` 2 there is room for every transition's mirror image in chunks of its own.
  Net(const Layer* given, int count, int join, int observations, int batch, int sides = 1)
      : layers(given, given + count),
        join(join),
        observations(observations),
        batch(batch),
        per((batch + CHUNK - 1) / CHUNK),
        chunks(sides * per),
        output(layers.back().out * CHUNK),
        rows(widest(layers) * CHUNK),
        slope(widest(layers) * CHUNK),
        next(widest(layers) * CHUNK) {
    for (const Layer& l : layers) {
      // `transpose` reads whole blocks, beyond the last row.
      inputs.emplace_back((static_cast<size_t>(chunks) * l.in + LANES) * CHUNK);
      products.emplace_back(l.gain ? static_cast<size_t>(chunks) * l.out * CHUNK : 0);
      statistics.emplace_back(l.gain ? static_cast<size_t>(chunks) * 2 * CHUNK : 0);
    }
  }

  int valid(int chunk) const { return std::min(CHUNK, batch - chunk % per * CHUNK); }
  float* input(int layer, int chunk) {
    return inputs[layer].at(static_cast<size_t>(chunk) * layers[layer].in * CHUNK);
  }

  void forward(const float* observation, const float* action, float* result) {
    const int last = static_cast<int>(layers.size()) - 1;
    for (int c = 0; c < chunks; c++) {
      turn_in(observation + static_cast<size_t>(c) * CHUNK * observations, observations, input(0, c),
              valid(c));
      if (join >= 0) {
        const int count = layers[join].in - before_actions();
        turn_in(action + static_cast<size_t>(c) * CHUNK * count, count, actions(c), valid(c));
      }
      run(c, output.at(0));
      turn_out(output.at(0), layers[last].out,
               result + static_cast<size_t>(c) * CHUNK * layers[last].out, valid(c));
    }
  }

  // The outputs (outputs x 64) of chunk c, whose inputs are in place.
  void run(int c, float* result) {
    const int last = static_cast<int>(layers.size()) - 1;
    for (int l = 0; l < last; l++) hidden(l, c);
    linear(layers[last], input(last, c), result, false);
  }

  // Where chunk c's actions go (actions x 64).
  float* actions(int c) { return input(join, c) + before_actions() * CHUNK; }
  int before_actions() const { return join == 0 ? observations : layers[join - 1].out; }

  void hidden(int l, int c) {
    const Layer& layer = layers[l];
    if (!layer.gain) return linear(layer, input(l, c), input(l + 1, c), true);
    float* z = products[l].at(static_cast<size_t>(c) * layer.out * CHUNK);
    linear(layer, input(l, c), z, false);
    normalise(layer, z, statistics[l].at(c * 2 * CHUNK), input(l + 1, c));
  }

  static void linear(const Layer& layer, const float* x, float* y, bool relu) {
    const Factors f{layer.weight, static_cast<size_t>(layer.in), 1, x, CHUNK, layer.in};
    auto bias = [&](int row, int) { return all(layer.bias[row]); };
    if (relu)
      product(f, layer.out, CHUNK, bias,
              [&](int row, int column, Vector v) { store(y + row * CHUNK + column, positive(v)); });
    else
      product(f, layer.out, CHUNK, bias,
              [&](int row, int column, Vector v) { store(y + row * CHUNK + column, v); });
  }

  static void normalise(const Layer& layer, const float* z, float* statistics, float* y) {
    const float share = 1.0f / layer.out;
    Vector mean[WIDE]{}, square[WIDE]{}, scale[WIDE];
    for (int n = 0; n < layer.out; n++)
      for (int w = 0; w < WIDE; w++) mean[w] += load(z + n * CHUNK + w * LANES);
    for (int w = 0; w < WIDE; w++) mean[w] *= all(share);
    for (int n = 0; n < layer.out; n++)
      for (int w = 0; w < WIDE; w++) {
        const Vector off = load(z + n * CHUNK + w * LANES) - mean[w];
        square[w] += off * off;
      }
    for (int w = 0; w < WIDE; w++) {
      for (int i = 0; i < LANES; i++)
        scale[w][i] = 1.0f / std::sqrt(square[w][i] * share + NORM_EPSILON);
      store(statistics + w * LANES, mean[w]);
      store(statistics + CHUNK + w * LANES, scale[w]);
    }
    for (int n = 0; n < layer.out; n++)
      for (int w = 0; w < WIDE; w++) {
        const int at = n * CHUNK + w * LANES;
        const Vector unit = (load(z + at) - mean[w]) * scale[w];
        store(y + at, positive(unit * all(layer.gain[n]) + all(layer.shift[n])));
      }
  }

  void backward(const float* given) {
    for (int c = 0; c < chunks; c++) {
      start(given, layers.back().out, c, slope.at(0));
      learn(c);
    }
  }

  // Slopes of all parameters from those at chunk c's outputs, which lie in `slope`.
  void learn(int c) {
    float *here = slope.at(0), *before = next.at(0);
    for (int l = static_cast<int>(layers.size()) - 1; l >= 0; l--) {
      collect(l, c, here);
      if (l == 0) break;
      through(l, c, here, before, true);
      std::swap(here, before);
    }
  }

  void action_slope(const float* given, float* result) {
    const int count = layers[join].in - before_actions();
    for (int c = 0; c < chunks; c++) {
      start(given, layers.back().out, c, slope.at(0));
      turn_out(at_actions(c), count, result + static_cast<size_t>(c) * CHUNK * count, valid(c));
    }
  }

  // Slopes at chunk c's actions (actions x 64) from those at its outputs, which lie in `slope`.
  float* at_actions(int c) {
    float *here = slope.at(0), *before = next.at(0);
    for (int l = static_cast<int>(layers.size()) - 1; l > join; l--) {
      through(l, c, here, before, false);
      std::swap(here, before);
    }
    const int first = before_actions();
    back(layers[join], here, first, layers[join].in - first, nullptr, before);
    return before;
  }

  // The slopes of chunk c at the output, zero beyond the batch.
  void start(const float* given, int outputs, int c, float* to) {
    for (int i = 0; i < outputs * CHUNK; i++) to[i] = 0.0f;
    turn_in(given + static_cast<size_t>(c) * CHUNK * outputs, outputs, to, valid(c));
  }

  // Slopes of layer l's weights and biases; the first chunk sets them, the others add.
  void collect(int l, int c, const float* at) {
    const Layer& layer = layers[l];
    const int width = (layer.in + LANES - 1) / LANES * LANES;
    const float* x = input(l, c);
    for (int n = 0; n < layer.in; n += LANES)
      for (int b = 0; b < CHUNK; b += LANES)
        transpose(x + n * CHUNK + b, CHUNK, rows.at(0) + b * width + n, width);
    const Factors f{at, CHUNK, 1, rows.at(0), static_cast<size_t>(width), valid(c)};
    float* to = layer.weight_slope;
    const int in = layer.in;
    product(
        f, layer.out, width,
        [&](int row, int column) {
          Vector sum{};
          if (c == 0) return sum;
          if (column + LANES <= in) return load(to + static_cast<size_t>(row) * in + column);
          const float* place = to + static_cast<size_t>(row) * in + column;
          for (int i = 0; column + i < in; i++) sum[i] = place[i];
          return sum;
        },
        [&](int row, int column, Vector v) {
          float* place = to + static_cast<size_t>(row) * in + column;
          if (column + LANES <= in) return store(place, v);
          for (int i = 0; column + i < in; i++) place[i] = v[i];
        });
    for (int n = 0; n < layer.out; n++) {
      const float sum = total(at + n * CHUNK);
      layer.bias_slope[n] = c == 0 ? sum : layer.bias_slope[n] + sum;
    }
  }

  // From the slope at layer l's product to that at the product before it.
  void through(int l, int c, const float* at, float* to, bool learn) {
    const Layer& before = layers[l - 1];
    back(layers[l], at, 0, before.out, input(l, c), to);
    if (before.gain) normalise_back(l - 1, c, to, learn);
  }

  // Slopes at inputs first .. first + count of a layer, zero where `active` is not positive.
  static void back(const Layer& layer, const float* at, int first, int count, const float* active,
                   float* to) {
    const Factors f{layer.weight + first, 1, static_cast<size_t>(layer.in), at, CHUNK, layer.out};
    product(
        f, count, CHUNK, [](int, int) { return Vector{}; },
        [&](int row, int column, Vector v) {
          const int place = row * CHUNK + column;
          store(to + place, !active ? v : load(active + place) > 0.0f ? v : Vector{});
        });
  }

  void normalise_back(int l, int c, float* at, bool learn) {
    const Layer& layer = layers[l];
    const float* z = products[l].at(static_cast<size_t>(c) * layer.out * CHUNK);
    const float* known = statistics[l].at(c * 2 * CHUNK);
    const float share = 1.0f / layer.out;
    for (int n = 0; learn && n < layer.out; n++) {
      Vector gain{}, shift{};
      for (int column = 0; column < CHUNK; column += LANES) {
        const Vector d = load(at + n * CHUNK + column);
        const Vector off = load(z + n * CHUNK + column) - load(known + column);
        gain += d * off * load(known + CHUNK + column);
        shift += d;
      }
      layer.gain_slope[n] = (c == 0 ? 0.0f : layer.gain_slope[n]) + across(gain);
      layer.shift_slope[n] = (c == 0 ? 0.0f : layer.shift_slope[n]) + across(shift);
    }
    Vector mean[WIDE], scale[WIDE], plain[WIDE]{}, weighted[WIDE]{};
    for (int w = 0; w < WIDE; w++) {
      mean[w] = load(known + w * LANES);
      scale[w] = load(known + CHUNK + w * LANES);
    }
    for (int n = 0; n < layer.out; n++)
      for (int w = 0; w < WIDE; w++) {
        const int place = n * CHUNK + w * LANES;
        const Vector d = load(at + place) * all(layer.gain[n]);
        plain[w] += d;
        weighted[w] += d * (load(z + place) - mean[w]) * scale[w];
      }
    for (int w = 0; w < WIDE; w++) {
      plain[w] *= all(share);
      weighted[w] *= all(share);
    }
    for (int n = 0; n < layer.out; n++)
      for (int w = 0; w < WIDE; w++) {
        const int place = n * CHUNK + w * LANES;
        const Vector d = load(at + place) * all(layer.gain[n]);
        const Vector unit = (load(z + place) - mean[w]) * scale[w];
        store(at + place, (d - plain[w] - unit * weighted[w]) * scale[w]);
      }
  }

  static float across(Vector v) {
    float sum = 0.0f;
    for (int i = 0; i < LANES; i++) sum += v[i];
    return sum;
  }
  static float total(const float* row) {
    Vector sum{};
    for (int column = 0; column < CHUNK; column += LANES) sum += load(row + column);
    return across(sum);
  }
  static void turn_in(const float* from, int width, float* to, int count) {
    for (int b = 0; b < count; b++)
      for (int n = 0; n < width; n++) to[n * CHUNK + b] = from[b * width + n];
  }
  static void turn_out(const float* from, int width, float* to, int count) {
    for (int b = 0; b < count; b++)
      for (int n = 0; n < width; n++) to[b * width + n] = from[n * CHUNK + b];
  }
};

}  // namespace
