// One whole update of `fused.py` for one thread: draw, targets, critics, actor, Adam, averages.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>

#include "network.h"

namespace {

struct Part {  // the parameters that one Adam moves, each array of `count` numbers
  float *value, *gradient, *mean, *square, *slow;  // slow: their running average, the target
  int64_t count;
};

struct Plan {  // what stays from update to update
  Net *actor, *actor_target, *critics[2], *critic_targets[2];
  Part acting, judging;  // the actor's and all critics' parameters
  float* average;        // of the actor's parameters, or null
  const float* scale;    // (inputs,) divisors of the observations
  const float* mirror;   // (seen,) 1 or -1: how a mirror changes them
  int64_t critic_count, batch, seen, inputs, actions;  // seen: what the actor has of the inputs
  int64_t symmetric, bounded, wanted;  // wanted: first column of the action to imitate
  double tau, average_share;
  float reward_scale, value_min, huber, clip, saturation, imitation, alpha;
};

struct Turn {  // one update
  const float* table;    // (rows, width) of the replay memory
  const int64_t* index;  // (batch,) rows drawn
  const float* sign;     // (batch,) -1 to mirror a transition, or null
  const float* noise;    // (batch, actions) added to the target's action, or null
  int64_t width;
  double judging_rate, acting_rate;     // Adam's
  int64_t judging_steps, acting_steps;  // made, with this one
  int64_t acts;                         // 0: the critics alone learn
  float critic_loss, q_data, q_policy;  // results
};

struct Learner {
  Plan p;
  int chunks;
  Memory drawn, target, value, raw, action, both;
  int observed, acted, following, rewarded, discounted, imitated;  // first rows of `drawn`

  explicit Learner(const Plan& plan)
      : p(plan),
        chunks((plan.batch + CHUNK - 1) / CHUNK),
        drawn(static_cast<size_t>(chunks) * rows(plan) * CHUNK),
        target(chunks * CHUNK),
        value(chunks * CHUNK),
        raw(static_cast<size_t>(chunks) * plan.actions * CHUNK),
        action(static_cast<size_t>(chunks) * plan.actions * CHUNK),
        both(2 * plan.actions * CHUNK),
        observed(0),
        acted(plan.inputs),
        following(plan.inputs + plan.actions),
        rewarded(2 * plan.inputs + plan.actions),
        discounted(rewarded + 1),
        imitated(rewarded + 2) {}

  static int rows(const Plan& p) { return 2 * p.inputs + 2 * p.actions + 2; }
  int valid(int c) const { return std::min<int64_t>(CHUNK, p.batch - c * CHUNK); }
  float* row(int c, int first) {
    return drawn.at((static_cast<size_t>(c) * rows(p) + first) * CHUNK);
  }
  float* actions_of(Memory& memory, int c) {
    return memory.at(static_cast<size_t>(c) * p.actions * CHUNK);
  }
  static float side(int action) { return action < 2 ? -1.0f : 1.0f; }  // of torque, displacement

  void update(Turn& t) {
    for (int c = 0; c < chunks; c++) draw(t, c);
    for (int c = 0; c < chunks; c++) aim(t, c);
    for (int k = 0; k < p.critic_count; k++) judge(t, k);
    adam(p.judging, t.judging_rate, t.judging_steps);
    if (!t.acts) return;
    act(t);
    adam(p.acting, t.acting_rate, t.acting_steps);
    follow(p.judging.slow, p.judging.value, p.judging.count, p.tau);
    follow(p.acting.slow, p.acting.value, p.acting.count, p.tau);
    if (p.average) follow(p.average, p.acting.value, p.acting.count, p.average_share);
  }

  // Rows of the memory, turned, scaled and mirrored.
  void draw(const Turn& t, int c) {
    for (int b = 0; b < valid(c); b++) {
      const int64_t which = c * CHUNK + b;
      const float* from = t.table + t.index[which] * t.width;
      const float sign = t.sign ? t.sign[which] : 1.0f;
      float* to = row(c, 0) + b;
      for (int n = 0; n < p.inputs; n++) {
        const float turned = n < p.seen && sign < 0.0f ? p.mirror[n] : 1.0f;
        to[(observed + n) * CHUNK] = from[n] / p.scale[n] * turned;
        to[(following + n) * CHUNK] = from[p.inputs + p.actions + n] / p.scale[n] * turned;
      }
      for (int n = 0; n < p.actions; n++) {
        const float turned = side(n) < 0.0f ? sign : 1.0f;
        to[(acted + n) * CHUNK] = from[p.inputs + n] * turned;
        if (p.imitation > 0.0f) to[(imitated + n) * CHUNK] = from[p.wanted + n] * turned;
      }
      const float* rest = from + 2 * p.inputs + p.actions;
      to[rewarded * CHUNK] = rest[0] * p.reward_scale;
      to[discounted * CHUNK] = rest[1];
    }
  }

  // The input of the actor's tanh (actions x 64) for observations (seen x 64).
  void answer(Net& actor, int c, const float* seen, float* result) {
    const size_t size = p.seen * CHUNK;
    std::memcpy(actor.input(0, c), seen, size * sizeof(float));
    if (!p.symmetric) return actor.run(c, result);
    float* mirrored = actor.input(0, c + chunks);
    for (size_t i = 0; i < size; i++) mirrored[i] = seen[i] * p.mirror[i / CHUNK];
    float *here = both.at(0), *there = both.at(p.actions * CHUNK);
    actor.run(c, here);
    actor.run(c + chunks, there);
    for (int n = 0; n < p.actions; n++)
      for (int i = n * CHUNK; i < (n + 1) * CHUNK; i++)
        result[i] = 0.5f * (here[i] + side(n) * there[i]);
  }

  void see(Net& critic, int c, const float* seen, const float* acting, float* result) {
    std::memcpy(critic.input(0, c), seen, p.inputs * CHUNK * sizeof(float));
    std::memcpy(critic.actions(c), acting, p.actions * CHUNK * sizeof(float));
    critic.run(c, result);
  }

  // The targets of the critics, equation (15).
  void aim(const Turn& t, int c) {
    float *next = actions_of(action, c), *to = target.at(c * CHUNK), *other = value.at(c * CHUNK);
    const float* seen = row(c, following);
    answer(*p.actor_target, c, seen, next);
    for (int i = 0; i < p.actions * CHUNK; i++) next[i] = std::tanh(next[i]);
    if (t.noise)
      for (int b = 0; b < valid(c); b++)
        for (int n = 0; n < p.actions; n++) {
          const float moved =
              next[n * CHUNK + b] + t.noise[(c * CHUNK + b) * p.actions + n];
          next[n * CHUNK + b] = std::min(std::max(moved, -1.0f), 1.0f);
        }
    see(*p.critic_targets[0], c, seen, next, to);
    if (p.critic_count > 1) {
      see(*p.critic_targets[1], c, seen, next, other);
      for (int b = 0; b < CHUNK; b++) to[b] = std::min(to[b], other[b]);
    }
    const float *reward = row(c, rewarded), *discount = row(c, discounted);
    for (int b = 0; b < CHUNK; b++) {
      to[b] = reward[b] + discount[b] * to[b];
      if (p.bounded) to[b] = std::min(std::max(to[b], p.value_min), 0.0f);
    }
  }

  // Slopes of critic k, equation (14).
  void judge(Turn& t, int k) {
    Net& net = *p.critics[k];
    const float huber = p.huber, share = (huber > 0.0f ? 1.0f : 2.0f) / p.batch;
    double loss = 0.0, sum = 0.0;
    for (int c = 0; c < chunks; c++) {
      float *q = value.at(c * CHUNK), *slope = net.slope.at(0);
      see(net, c, row(c, observed), row(c, acted), q);
      for (int b = 0; b < CHUNK; b++) slope[b] = 0.0f;
      for (int b = 0; b < valid(c); b++) {
        float error = q[b] - target.at(0)[c * CHUNK + b];
        sum += q[b];
        if (huber > 0.0f) {
          const float size = std::fabs(error);
          loss += size < huber ? 0.5f * error * error : huber * (size - 0.5f * huber);
          error = std::min(std::max(error, -huber), huber);
        } else {
          loss += error * error;
        }
        slope[b] = error * share;
      }
      net.learn(c);
    }
    const int64_t own = p.judging.count / p.critic_count;
    bound(p.judging.gradient + k * own, own);
    if (k == 0) t.critic_loss = loss / p.batch, t.q_data = sum / p.batch;
  }

  // Slopes of the actor, equation (17).
  void act(Turn& t) {
    Net& critic = *p.critics[0];
    double sum = 0.0, size = 0.0;
    for (int c = 0; c < chunks; c++) {
      float *before = actions_of(raw, c), *to = actions_of(action, c), *q = value.at(c * CHUNK);
      answer(*p.actor, c, row(c, observed), before);
      for (int i = 0; i < p.actions * CHUNK; i++) to[i] = std::tanh(before[i]);
      see(critic, c, row(c, observed), to, q);
      for (int b = 0; b < valid(c); b++) sum += q[b], size += std::fabs(q[b]);
    }
    t.q_policy = sum / p.batch;
    const float mean = std::max<float>(size / p.batch, 1e-6f);
    const float weight = p.imitation > 0.0f ? p.alpha / mean : 1.0f;
    for (int c = 0; c < chunks; c++) climb(c, weight);
    bound(p.acting.gradient, p.acting.count);
  }

  // Adds chunk c to the actor's slopes; `weight` is that of the critic's value.
  void climb(int c, float weight) {
    Net &critic = *p.critics[0], &actor = *p.actor;
    const float share = 2.0f / (p.batch * p.actions);
    for (int b = 0; b < CHUNK; b++) critic.slope.at(0)[b] = b < valid(c) ? -1.0f / p.batch : 0.0f;
    float* slope = critic.at_actions(c);
    const float *now = actions_of(action, c), *before = actions_of(raw, c);
    for (int n = 0; n < p.actions; n++)
      for (int b = 0; b < CHUNK; b++) {
        const int i = n * CHUNK + b;
        float s = slope[i] * weight;
        if (p.imitation > 0.0f) s += share * p.imitation * (now[i] - row(c, imitated)[i]);
        s *= 1.0f - now[i] * now[i];
        if (p.saturation > 0.0f) s += share * p.saturation * before[i];
        slope[i] = b < valid(c) ? s : 0.0f;
      }
    for (int other = 0; other <= (p.symmetric ? 1 : 0); other++) {
      for (int n = 0; n < p.actions; n++) {
        const float part = p.symmetric ? (other ? 0.5f * side(n) : 0.5f) : 1.0f;
        for (int b = 0; b < CHUNK; b++)
          actor.slope.at(0)[n * CHUNK + b] = part * slope[n * CHUNK + b];
      }
      actor.learn(c + other * chunks);
    }
  }

  void bound(float* gradient, int64_t count) const {
    if (p.clip <= 0.0f) return;
    double square = 0.0;
    for (int64_t i = 0; i < count; i++) square += double(gradient[i]) * gradient[i];
    const float factor = std::min(1.0f, p.clip / (static_cast<float>(std::sqrt(square)) + 1e-6f));
    for (int64_t i = 0; i < count; i++) gradient[i] *= factor;
  }

  static void adam(const Part& part, double rate, int64_t steps) {
    constexpr double BETA_1 = 0.9, BETA_2 = 0.999;
    const float step = rate / (1.0 - std::pow(BETA_1, steps));
    const float root = 1.0 / std::sqrt(1.0 - std::pow(BETA_2, steps));
    const float keep = BETA_2, take = 1.0 - BETA_2, share = 1.0 - BETA_1, least = 1e-8;
    float* __restrict value = part.value;
    float* __restrict mean = part.mean;
    float* __restrict square = part.square;
    const float* __restrict gradient = part.gradient;
    for (int64_t i = 0; i < part.count; i++) {
      const float g = gradient[i], m = mean[i] + share * (g - mean[i]);
      const float v = keep * square[i] + take * g * g;
      mean[i] = m;
      square[i] = v;
      value[i] -= step * m / (std::sqrt(v) * root + least);
    }
  }

  static void follow(float* __restrict slow, const float* __restrict value, int64_t count,
                     double share) {
    const float part = share;
    for (int64_t i = 0; i < count; i++) slow[i] += part * (value[i] - slow[i]);
  }
};

}  // namespace
