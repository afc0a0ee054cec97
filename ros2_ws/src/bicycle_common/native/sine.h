// trigonometry.py of the plants, compiled: the same operations in the same order, for the same bits.
//
// Include it where D names the type of an angle, double or a vector of doubles. Each kind of vector
// instructions needs its own copy, so there is no guard against a second one.

ALWAYS void sine_cosine(D angle, D& sine, D& cosine) {
  const D half = 0.5 * angle, square = half * half;
  D s = -1.0 / 1307674368000.0 - D{}, c = 1.0 / 20922789888000.0 - D{};  // in every lane
  s = 1.0 / 6227020800.0 + square * s;
  s = -1.0 / 39916800.0 + square * s;
  s = 1.0 / 362880.0 + square * s;
  s = -1.0 / 5040.0 + square * s;
  s = 1.0 / 120.0 + square * s;
  s = -1.0 / 6.0 + square * s;
  s = 1.0 + square * s;
  c = -1.0 / 87178291200.0 + square * c;
  c = 1.0 / 479001600.0 + square * c;
  c = -1.0 / 3628800.0 + square * c;
  c = 1.0 / 40320.0 + square * c;
  c = -1.0 / 720.0 + square * c;
  c = 1.0 / 24.0 + square * c;
  c = -1.0 / 2.0 + square * c;
  c = 1.0 + square * c;
  s = half * s;
  sine = 2.0 * s * c;
  cosine = 1.0 - 2.0 * (s * s);
}

ALWAYS void sine_cosine_of_turn(D angle, D& sine, D& cosine) {
  D s, c;
  sine_cosine(0.5 * angle, s, c);
  sine = 2.0 * s * c;
  cosine = 1.0 - 2.0 * (s * s);
}
