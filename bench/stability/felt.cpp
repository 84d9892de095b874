#include "bench/stability/felt.h"
#include "bench/stability/servo_period.h"
#include "bench/stability/spring_law.h"

#include <cmath>
#include <deque>

#include "bench/stability/renderers.h"
#include "client/experiment/spring_tissue.h"
#include "client/haptic/profiles.h"
#include "client/haptic/quantised_reading.h"
#include "client/render/force_chain.h"

namespace teletact::bench {
namespace {

using client::ForceSample;
using client::SpringTissue;
using client::ToolPose;
using client::Vector3;

constexpr double kCentreM = 0.06, kHalfWidthM = 0.01, kWayM = 0.09;
constexpr double kJudgedM = 0.01;
constexpr std::uint64_t kVersion = 1;
constexpr double kBackgroundBeginM = 0.03, kBackgroundEndM = 0.045;

struct Mean {
  double sum = 0, count = 0;
  void add(double value) { sum += value, ++count; }
  double value() const { return sum / count; }
};

// The mean over `length` neighbours that is furthest from `reference`.
double max_different(const std::vector<double>& values, std::size_t length, double reference) {
  double sum = 0, found = reference;
  for (std::size_t n = 0; n < values.size(); ++n) {
    sum += values[n];
    if (n >= length) sum -= values[n - length];
    if (n + 1 < length) continue;
    const double mean = sum / static_cast<double>(length);
    if (std::abs(mean - reference) > std::abs(found - reference)) found = mean;
  }
  return found;
}

double one_pass(const FeltOptions& o, const SpringTissue& tissue, double share) {
  const auto renderer = make_any_renderer(o.renderer, kServoS);
  client::ForceChainOptions chain_options;
  chain_options.limits = client::device_profile("premium-1.5").limits();
  client::ForceChain chain(chain_options);
  // What waits there was told before the finger arrived.
  ForceSample foreseen = tissue.answer({0, o.indentation_m, 0});
  foreseen.contact = false;
  foreseen.foreseen = true;
  foreseen.model_version = kVersion;
  renderer->update(foreseen, {}, 0);
  std::deque<ForceSample> on_the_way;
  double next_s = share * o.update_s, told_m = 0;
  Mean background;
  std::vector<double> felt;
  for (int tick = 0; tick * kServoS * o.speed_m_s < kWayM; ++tick) {
    const double time_s = tick * kServoS;
    const double sway = 1 + 0.1 * std::sin(2 * M_PI * (3 * time_s + share));
    const Vector3 exact_m(o.speed_m_s * time_s, o.indentation_m * sway, 0);
    const ToolPose pose{client::quantised(exact_m, o.resolution_m), {o.speed_m_s, 0, 0}};
    if (time_s >= next_s) {
      on_the_way.push_back(tissue.answer(pose.position_m));
      on_the_way.back().pose_time_s = time_s;
      on_the_way.back().model_version = kVersion;
      next_s += o.update_s;
    }
    if (o.renderer == "law" && exact_m.x() >= told_m) {
      constexpr double kApartM = 0.001, kBehindM = 0.03, kEveryM = 0.01;
      renderer->take_law(spring_law(tissue, told_m - kBehindM, kApartM, 1, kVersion));
      told_m += kEveryM;
    }
    while (!on_the_way.empty() && on_the_way.front().pose_time_s + o.model_delay_s <= time_s) {
      renderer->update(on_the_way.front(), pose, time_s);
      on_the_way.pop_front();
    }
    client::ForceChainInput input;
    input.rendered = renderer->render(pose, time_s, chain.ledger());
    input.pose = pose;
    input.on = true;
    input.enabled_s = 10;
    input.model_age_s = o.model_delay_s;
    input.period_s = o.update_s;
    const double felt_n_m = -chain.apply(input).force_n.y() / exact_m.y();
    if (exact_m.x() > kBackgroundEndM) felt.push_back(felt_n_m);
    if (exact_m.x() > kBackgroundBeginM && exact_m.x() <= kBackgroundEndM) background.add(felt_n_m);
  }
  const auto judged = static_cast<std::size_t>(std::lround(kJudgedM / (o.speed_m_s * kServoS)));
  return tissue.background_n_m * max_different(felt, judged, background.value()) / background.value();
}

}  // namespace

std::vector<double> felt_stiffness(const FeltOptions& options, double background_n_m, double stimulus_n_m,
                                   unsigned passes) {
  std::vector<double> felt;
  for (unsigned pass = 0; pass < passes; ++pass)
    felt.push_back(one_pass(options, {background_n_m, stimulus_n_m, kCentreM, kHalfWidthM, options.edge_m},
                            (pass + 0.5) / passes));
  return felt;
}

}  // namespace teletact::bench
