// An actor's forward pass for one bicycle; `inference.py` prepares what it takes.
//
// Every output is summed in the order of the inputs, and products are rounded before they are
// added, so that all processors give the same bits, however many numbers they take at once.

#include <cmath>

#include "compiler.h"

extern "C" {

struct Layer {
  int blocks;                     // 1, or 2 halves that are not connected
  int inputs, outputs;            // of one block
  const float* weights[2];        // of each block, inputs x outputs
  const float* bias;              // for the outputs of all blocks, as are the next two
  const float *gain, *offset;     // of layer normalisation; null without
};

}  // extern "C"

namespace {

constexpr int TOGETHER = 4;  // inputs that are added in one pass over the outputs

WIDEST void multiply(const Layer& layer, const float* inputs, float* __restrict__ outputs) {
  const int width = layer.outputs;
  for (int block = 0; block < layer.blocks; ++block) {
    const float *rows[TOGETHER], *weights = layer.weights[block];
    float values[TOGETHER];
    int waiting = 0;
    for (int i = 0; i < layer.inputs; ++i) {
      rows[waiting] = weights + static_cast<long>(i) * width;
      values[waiting] = inputs[i];
      waiting += inputs[i] != 0.0f;  // half of them are zero behind a relu
      if (waiting < TOGETHER) continue;
      for (int o = 0; o < width; ++o) {
        float sum = outputs[o];
        for (int k = 0; k < TOGETHER; ++k) sum += rows[k][o] * values[k];
        outputs[o] = sum;
      }
      waiting = 0;
    }
    for (int k = 0; k < waiting; ++k) {
      for (int o = 0; o < width; ++o) outputs[o] += rows[k][o] * values[k];
    }
    inputs += layer.inputs;
    outputs += width;
  }
}

void normalise(const Layer& layer, float epsilon, float* values) {
  const int count = layer.blocks * layer.outputs;
  float squares = 0.0f;  // their mean is zero already
  for (int o = 0; o < count; ++o) squares += values[o] * values[o];
  const float share = 1.0f / std::sqrt(squares / count + epsilon);
  for (int o = 0; o < count; ++o) values[o] = values[o] * (share * layer.gain[o]) + layer.offset[o];
}

}  // namespace

extern "C" {

// Fills `action` (outputs of the last layer) from `observation` (inputs of the first), both in
// physical units. `memory` holds the widest layer twice.
void actor_forward(const Layer* layers, int count, float epsilon, const double* observation,
                   const double* limits, float* memory, int widest, double* action) {
  float *inputs = memory, *outputs = memory + widest;
  for (int i = 0; i < layers[0].inputs; ++i) inputs[i] = static_cast<float>(observation[i]);
  for (int index = 0; index < count; ++index) {
    const Layer& layer = layers[index];
    const int width = layer.blocks * layer.outputs;
    for (int o = 0; o < width; ++o) outputs[o] = layer.bias[o];
    multiply(layer, inputs, outputs);
    if (index == count - 1) {
      for (int o = 0; o < width; ++o) action[o] = limits[o] * std::tanh(double(outputs[o]));
      return;
    }
    if (layer.gain != nullptr) normalise(layer, epsilon, outputs);
    for (int o = 0; o < width; ++o) outputs[o] = outputs[o] < 0.0f ? 0.0f : outputs[o];
    float* other = inputs;
    inputs = outputs;
    outputs = other;
  }
}

}  // extern "C"
