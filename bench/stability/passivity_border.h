// Where a held, delayed spring stops being passive, found as the energy of the worst imposed motion, not from
// a formula: the check of (T5.2), with which it shares nothing.
//
// A spring K is sampled at k T, its force acts from k T + t_d to (k + 1) T + t_d, and the display damps with
// b. An imposed motion x(t) that begins and ends at rest at x = 0 puts in
//     E = Int b v^2 + f v dt,
// and the display is passive when no motion makes E < 0. Between the instants where the position is sampled
// (k T) and where the force changes (k T + e T, e = frac(t_d / T)) the cheapest way is straight, so the
// positions at these 2 N instants are all that matters: E = b A(x) + K B(x), two quadratic forms, and the
// border is
//     b / (K T) = max over x of -B(x) / (T A(x)).
// The worst motion stops and goes within each period: a sinusoid, whatever its frequency, hides part of it.
#pragma once

#include <cstddef>
#include <vector>

namespace teletact::bench {

// Straight pieces between instants.
struct ImposedMotion {
  std::vector<double> time_periods;  // in T, increasing
  std::vector<double> position;      // any unit; 0 at both ends
};

// The worst of all motions over `periods` sampling periods, for a delay of `delay_periods` >= 0 (in T). The
// longer, the closer to the border, from below: (periods / (1 + delay))^-2 remains.
ImposedMotion worst_motion(double delay_periods, std::size_t periods);

// The damping (N s/m) at which that motion costs nothing on a hold renderer: stiffness_n_m,
// sampled every period_s, each answer arriving delay_s after its pose. 0 when it costs something without any
// damping.
double border_n_s_m(const ImposedMotion&, double stiffness_n_m, double period_s, double delay_s);

// (T5.2): b = (K T/2) [(1/2 + d) + sqrt((1/2 + d)^2 + e (1 - e))], d = t_d / T, e = frac(d).
double colgate_border_n_s_m(double stiffness_n_m, double period_s, double delay_s);

}  // namespace teletact::bench
