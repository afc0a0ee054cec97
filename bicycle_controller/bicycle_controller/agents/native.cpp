// What `native.py` and `native_update.py` call; they say what each function takes.

#include "ddpg.h"

extern "C" {

// Null when there is no memory for it.
Net* net_new(const Layer* layers, int count, int join, int observations, int batch, int sides) {
  try {
    return new Net(layers, count, join, observations, batch, sides);
  } catch (const std::bad_alloc&) {
    return nullptr;
  }
}
void net_free(Net* net) { delete net; }
void net_forward(Net* net, const float* observation, const float* action, float* result) {
  net->forward(observation, action, result);
}
void net_backward(Net* net, const float* slope) { net->backward(slope); }
void net_action_slope(Net* net, const float* slope, float* result) {
  net->action_slope(slope, result);
}

Learner* learner_new(const Plan* plan) {
  try {
    return new Learner(*plan);
  } catch (const std::bad_alloc&) {
    return nullptr;
  }
}
void learner_free(Learner* learner) { delete learner; }
void learner_update(Learner* learner, Turn* turn) { learner->update(*turn); }

}  // extern "C"
