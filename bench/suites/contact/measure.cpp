// One method on one case. An iterative one walks down a ladder of its own tolerances, half a decade a step,
// until its force is within the goal twice in a row (an error may cross zero on its way), and is timed at the
// first of the two.
#include <fmt/format.h>

#include <cmath>
#include <functional>
#include <optional>

#include "bench/basics/clock.h"
#include "bench/basics/median.h"
#include "bench/suites/contact/contact.h"

namespace teletact::bench {
namespace {

constexpr std::size_t kMaxSurfaceDofs = 30000;  // two solves for every column: minutes beyond

struct Budget {
  double repeat_s, ladder_s;  // time to spend on the repeats of one figure, and on the ladder
  int least, most;            // repeats
};

Budget budget(bool quick) {
  return quick ? Budget{0.1, 15, 2, 100} : Budget{0.2, 40, 3, 300};
}

// `once` returns seconds that it measured itself, or < 0.
Quantiles repeat(const Budget& b, const std::function<double()>& once) {
  constexpr double kLongS = 5;  // once is enough
  std::vector<double> seconds;
  double spent = 0;
  while (static_cast<int>(seconds.size()) < b.least ||
         (spent < b.repeat_s && static_cast<int>(seconds.size()) < b.most)) {
    const auto begin = Clock::now();
    const double own = once();
    const double outside = seconds_since(begin);
    seconds.push_back(own >= 0 ? own : outside);
    spent += outside;
    if (outside > kLongS) break;
  }
  return quantiles(seconds);
}

struct Attempt {
  Rung rung;
  PeerAnswer answer;
};

Attempt try_rung(Peer& peer, const ContactProblem& p, double tolerance) {
  if (peer.ours() && peer.iterative()) peer.touch(p, tolerance);  // the first at a tolerance allocates
  const auto begin = Clock::now();
  PeerAnswer answer = peer.touch(p, tolerance);
  const double seconds = answer.seconds >= 0 ? answer.seconds : seconds_since(begin);
  const Rung rung{tolerance, seconds, answer.iterations, p.force_error(answer.force_n)};
  return {rung, std::move(answer)};
}

// The loosest rung from which on two in a row are good enough, else the best.
Attempt climb(Peer& peer, const ContactProblem& p, bool whole, const Budget& b, std::vector<Rung>& ladder) {
  constexpr int kLoosest = 4, kTightest = 24;  // 10^(-k/2)
  const auto begin = Clock::now();
  std::optional<Attempt> chosen, best;
  bool confirmed = false;
  for (int k = kLoosest; k <= kTightest; ++k) {
    const Attempt attempt = try_rung(peer, p, std::pow(10.0, -0.5 * k));
    ladder.push_back(attempt.rung);
    const bool good = attempt.rung.force_error <= kForceGoal;
    if (!best || attempt.rung.force_error < best->rung.force_error) best = attempt;
    if (!good && !confirmed) chosen.reset();
    confirmed = confirmed || (good && chosen);
    if (confirmed && !whole) break;
    if (good && !chosen) chosen = attempt;
    if (seconds_since(begin) > b.ladder_s) break;
  }
  return confirmed ? *chosen : *best;
}

void time(Peer& peer, const ContactProblem& p, bool whole_ladder, const Budget& b, MethodFigures& out) {
  peer.prepare(p);  // the first may compile kernels
  out.setup_s = repeat(b, [&] { return peer.prepare(p); });
  const Attempt attempt =
      peer.iterative() ? climb(peer, p, whole_ladder, b, out.ladder) : try_rung(peer, p, 0);
  const PeerAnswer& answer = attempt.answer;
  out.kept_bytes_per_unknown =
      static_cast<double>(peer.kept_bytes()) / static_cast<double>(p.tissue.grid.dofs());
  out.tolerance = attempt.rung.tolerance;
  out.iterations = answer.iterations;
  out.force_error = attempt.rung.force_error;
  out.displacement_error =
      answer.displacement_m.size() > 0 ? p.displacement_error(answer.displacement_m) : kNan;
  out.stated_error = answer.stated_error;
  out.goal_met = out.force_error <= kForceGoal;
  peer.touch(p, out.tolerance);
  const Quantiles touch_s = repeat(b, [&] { return peer.touch(p, out.tolerance).seconds; });
  const auto if_it_does = [&](Quantiles& seconds, auto&& once) {
    if (once()) seconds = repeat(b, [&] { return once() ? -1.0 : 0.0; });
  };
  if_it_does(out.one_solve_s, [&] { return peer.solve_once(p); });
  if (p.tissue.grid.dofs() <= kMaxSurfaceDofs)
    if_it_does(out.surface_s, [&] { return peer.condense_surface(p); });
  out.touch_s = touch_s;  // it is measured
}

}  // namespace

MethodFigures measure_method(Peer& peer, const ContactProblem& p, bool whole_ladder, bool quick) {
  MethodFigures out{peer.name(), peer.ours(), peer.iterative(), peer.products_choice(p)};
  if (p.tissue.grid.dofs() > peer.max_unknowns()) {
    out.declined = fmt::format("more than {} unknowns would take minutes", peer.max_unknowns());
    return out;
  }
  try {
    time(peer, p, whole_ladder, budget(quick), out);
  } catch (const std::exception& error) {  // a rival that breaks down is a result, not the end of the chart
    out.failed = error.what();
  }
  return out;
}

double log_slope(const std::vector<double>& x, const std::vector<double>& y) {
  double sx = 0, sy = 0, sxx = 0, sxy = 0;
  const double n = static_cast<double>(x.size());
  for (std::size_t k = 0; k < x.size(); ++k) {
    const double a = std::log(x[k]), b = std::log(y[k]);
    sx += a;
    sy += b;
    sxx += a * a;
    sxy += a * b;
  }
  return x.size() < 2 ? kNan : (n * sxy - sx * sy) / (n * sxx - sx * sx);
}

}  // namespace teletact::bench
