// One method on one case. An iterative one walks down a ladder of its own tolerances, half a decade a step,
// until its force is within the goal twice in a row (an error may cross zero on its way), and is timed at the
// first of the two.
#include <chrono>
#include <cmath>
#include <functional>
#include <limits>
#include <optional>

#include "bench/suites/contact/contact.h"

namespace teletact::bench {
namespace {

using Clock = std::chrono::steady_clock;
using nlohmann::json;

double seconds_since(Clock::time_point begin) {
  return std::chrono::duration<double>(Clock::now() - begin).count();
}

constexpr std::size_t kMostSurfaceDofs = 30000;  // two solves for every column: minutes beyond

struct Budget {
  double repeat_s, ladder_s;  // time to spend on the repeats of one figure, and on the ladder
  int least, most;            // repeats
};

Budget budget(bool quick) {
  return quick ? Budget{0.1, 15, 2, 100} : Budget{0.2, 40, 3, 300};
}

// `once` returns seconds that it measured itself, or < 0.
json repeat(const Budget& b, const std::function<double()>& once) {
  constexpr double kLongS = 5;  // once is enough
  std::vector<double> seconds;
  double spent = 0, least = std::numeric_limits<double>::infinity();
  while (static_cast<int>(seconds.size()) < b.least ||
         (spent < b.repeat_s && static_cast<int>(seconds.size()) < b.most)) {
    const auto begin = Clock::now();
    const double own = once();
    const double outside = seconds_since(begin);
    seconds.push_back(own >= 0 ? own : outside);
    spent += outside;
    least = std::min(least, seconds.back());
    if (outside > kLongS) break;
  }
  json out = quantiles(seconds);
  out["min"] = least;
  return out;
}

struct Rung {
  double tolerance = 0, seconds = 0, error = 0;
  PeerAnswer answer;
};

json describe(const Rung& r) {
  return {{"tolerance", r.tolerance},
          {"seconds", r.seconds},
          {"iterations", r.answer.iterations},
          {"force_error", r.error}};
}

Rung try_rung(Peer& peer, const ContactProblem& p, double tolerance) {
  if (peer.ours() && peer.iterative()) peer.touch(p, tolerance);  // the first at a tolerance allocates
  const auto begin = Clock::now();
  Rung rung;
  rung.tolerance = tolerance;
  rung.answer = peer.touch(p, tolerance);
  rung.seconds = rung.answer.seconds >= 0 ? rung.answer.seconds : seconds_since(begin);
  rung.error = p.force_error(rung.answer.force_n);
  return rung;
}

// The loosest rung from which on two in a row are good enough, else the best.
Rung climb(Peer& peer, const ContactProblem& p, bool whole, const Budget& b, json& ladder) {
  constexpr int kLoosest = 4, kTightest = 24;  // 10^(-k/2)
  const auto begin = Clock::now();
  std::optional<Rung> chosen, best;
  bool confirmed = false;
  for (int k = kLoosest; k <= kTightest; ++k) {
    Rung rung = try_rung(peer, p, std::pow(10.0, -0.5 * k));
    ladder.push_back(describe(rung));
    const bool good = rung.error <= kForceGoal;
    if (!best || rung.error < best->error) best = rung;
    if (!good && !confirmed) chosen.reset();
    confirmed = confirmed || (good && chosen);
    if (confirmed && !whole) break;
    if (good && !chosen) chosen = rung;
    if (seconds_since(begin) > b.ladder_s) break;
  }
  return confirmed ? *chosen : *best;
}

json timed(Peer& peer, const ContactProblem& p, bool whole_ladder, const Budget& b) {
  peer.prepare(p);  // the first may compile kernels
  json out{{"setup_s", repeat(b, [&] { return peer.prepare(p); })}};
  Rung rung;
  if (peer.iterative()) {
    out["ladder"] = json::array();
    rung = climb(peer, p, whole_ladder, b, out["ladder"]);
  } else {
    rung = try_rung(peer, p, 0);
  }
  if (const std::size_t bytes = peer.kept_bytes(); bytes > 0)
    out["kept_bytes_per_unknown"] = static_cast<double>(bytes) / static_cast<double>(p.tissue.grid.dofs());
  out["tolerance"] = rung.tolerance;
  out["iterations"] = rung.answer.iterations;
  out["force_error"] = rung.error;
  if (rung.answer.displacement_m.size() > 0)
    out["displacement_error"] = p.displacement_error(rung.answer.displacement_m);
  out["stated_error"] = rung.answer.stated_error;
  out["goal_met"] = rung.error <= kForceGoal;
  peer.touch(p, rung.tolerance);
  out["touch_s"] = repeat(b, [&] { return peer.touch(p, rung.tolerance).seconds; });
  out["touches_per_s"] = 1 / out["touch_s"]["p50"].get<double>();
  const auto if_it_does = [&](const char* name, auto&& once) {
    if (once()) out[name] = repeat(b, [&] { return once() ? -1.0 : 0.0; });
  };
  if_it_does("one_solve_s", [&] { return peer.solve_once(p); });
  if (p.tissue.grid.dofs() <= kMostSurfaceDofs)
    if_it_does("surface_s", [&] { return peer.condense_surface(p); });
  return out;
}

}  // namespace

json measure_method(Peer& peer, const ContactProblem& p, bool whole_ladder, bool quick) {
  json out{{"method", peer.name()},
           {"ours", peer.ours()},
           {"iterative", peer.iterative()},
           {"products_choice", peer.products_choice(p)}};
  if (const std::string why = peer.declines(p); !why.empty()) {
    out["declined"] = why;
    return out;
  }
  try {
    out.update(timed(peer, p, whole_ladder, budget(quick)));
  } catch (const std::exception& error) {  // a rival that breaks down is a result, not the end of the chart
    out["failed"] = error.what();
  }
  return out;
}

std::vector<json> measured_methods(const json& of_case) {
  std::vector<json> methods;
  for (const json& method : of_case.at("methods"))
    if (method.contains("touch_s")) methods.push_back(method);
  return methods;
}

double cold_s(const json& method) {
  return method.at("setup_s").at("p50").get<double>() + method.at("touch_s").at("p50").get<double>();
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
  return x.size() < 2 ? std::numeric_limits<double>::quiet_NaN() : (n * sxy - sx * sy) / (n * sxx - sx * sx);
}

}  // namespace teletact::bench
