#include "bench/stability/fuzz.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <random>
#include <vector>

#include "client/render/force_chain.h"
#include "client/render/renderers.h"

namespace teletact::bench {
namespace {

using client::ForceChainInput;
using client::ForceSample;
using client::Vector2;

class Source {
 public:
  explicit Source(std::uint64_t seed) : random_(seed) {}
  std::uint64_t one_of(std::uint64_t count) { return random_() % count; }
  double uniform() { return distribution_(random_); }
  double wild() {
    switch (one_of(8)) {
      case 0:
        return std::numeric_limits<double>::quiet_NaN();
      case 1:
        return std::numeric_limits<double>::infinity() * uniform();
      case 2:
        return 1e300 * uniform();
      case 3:
        return 0;
      default:
        return std::pow(10, 4 * uniform()) * uniform();
    }
  }
  // Of that scale for half of the cases, anything for the others.
  void begin_case() { tame_ = one_of(2) == 0; }
  double number(double scale) { return tame_ ? scale * uniform() : wild(); }

 private:
  std::mt19937_64 random_;
  std::uniform_real_distribution<double> distribution_{-1, 1};
  bool tame_ = true;
};

ForceSample sample_from(Source& source) {
  ForceSample sample;
  sample.position_m = Vector2(source.number(0.1), source.number(0.01));
  sample.force_n = Vector2(source.number(5), source.number(5));
  sample.tangent_n_m << source.number(500), source.number(500), source.number(500), source.number(500);
  sample.pose_time_s = source.number(10);
  sample.surface_m = source.one_of(20) == 0 ? source.number(0.01) : 0;
  sample.contact = source.one_of(4) != 0;
  return sample;
}

ForceChainInput input_from(Source& source) {
  ForceChainInput input;
  input.pose.position_m = Vector2(source.uniform() * 0.1, source.uniform() * 0.02);
  input.pose.velocity_m_s = Vector2(source.number(0.3), source.number(0.3));
  if (source.one_of(50) == 0) input.pose.position_m.y() = source.wild();
  input.surface_m = source.one_of(50) == 0 ? source.wild() : 0;
  input.on = source.one_of(10) != 0;
  input.enabled_s = source.number(2);
  input.silence_s = source.number(0.1);
  input.model_age_s = source.number(0.3);
  input.period_s = source.number(0.01);
  input.dt_s = source.one_of(20) == 0 ? source.wild() : 0.001;
  return input;
}

}  // namespace

FuzzResult fuzz_forces(std::size_t cases, std::uint64_t seed) {
  constexpr double kRounding = 1e-12;
  Source source(seed);
  const client::ForceChainOptions options;
  client::ForceChain chain(options);
  std::vector<std::unique_ptr<client::Renderer>> renderers;
  for (const std::string& name : client::renderer_names())
    renderers.push_back(client::make_renderer(name, 0.001));
  FuzzResult result;
  Vector2 last_n = Vector2::Zero();
  for (; result.cases < cases; ++result.cases) {
    source.begin_case();
    const double time_s = 1e-3 * static_cast<double>(result.cases);
    ForceChainInput input = input_from(source);
    const ForceSample sample = sample_from(source);
    client::Renderer& renderer = *renderers[result.cases / 1000 % renderers.size()];
    if (client::is_finite(sample)) renderer.update(sample, input.pose, time_s);
    input.rendered = renderer.render(input.pose, time_s);
    if (source.one_of(10) == 0) input.rendered.force_n = Vector2(source.wild(), source.wild());
    const Vector2 force_n = chain.apply(input).force_n;
    const double dt_s = std::isfinite(input.dt_s) ? std::clamp(input.dt_s, 0.0, options.longest_dt_s) : 0.0;
    const double step_n = (force_n - last_n).norm(), most_n = options.limits.largest_force_n;
    if (!force_n.allFinite()) ++result.not_finite;
    if (!(force_n.norm() <= most_n * (1 + kRounding))) ++result.too_large;
    if (!(step_n <= options.limits.largest_slew_n_s * dt_s + kRounding)) ++result.too_fast;
    last_n = force_n;
  }
  return result;
}

}  // namespace teletact::bench
