// Another version of the tissue, or another model of it, under a finger that rests and is felt by answers
// alone: gradually, and in the end as it is.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <tuple>
#include <vector>

#include "client/render/law_renderer.h"

namespace teletact::client {
namespace {

constexpr double kTickS = 0.001, kDepthM = 0.002;

ForceSample answer_of(double stiffness_n_m, double lateral_n_m, std::uint64_t version, std::uint64_t sequence,
                      double time_s) {
  ForceSample sample;
  sample.sequence = sequence, sample.model_version = version;
  sample.pose_time_s = time_s;
  sample.position_m = {0.02, kDepthM, 0.004};
  sample.contact = true;
  sample.force_n = kDepthM * Vector3(lateral_n_m, -stiffness_n_m, -2 * lateral_n_m);
  sample.tangent_n_m(1, 1) = -1.5 * stiffness_n_m;
  return sample;
}

// A second on each of these, versions or `models` of one, an answer every `answers_s`: the force at every
// tick. Everything is paid for.
std::vector<Vector3> felt(const std::vector<std::pair<double, double>>& versions, double answers_s,
                          bool models) {
  LawRenderer renderer;
  std::vector<Vector3> forces;
  std::uint64_t sequence = 0;
  double time_s = 0, next_s = 0;
  for (std::size_t n = 0; n < versions.size(); ++n)
    for (int tick = 0; tick < 1000; ++tick) {
      time_s += kTickS;
      const ToolPose pose{{0.02, kDepthM, 0.004}, Vector3::Zero()};
      if (time_s >= next_s) {
        next_s += answers_s;
        ForceSample answer =
            answer_of(versions[n].first, versions[n].second, models ? 1 : n + 1, ++sequence, time_s);
        if (models) answer.solved_by = std::uint32_t(n + 1);
        renderer.update(answer, pose, time_s);
      }
      forces.push_back(renderer.render(pose, time_s).force_n);
    }
  return forces;
}

TEST(Versions, AreFeltByUnderSevenPercentInTenMilliseconds) {
  constexpr std::size_t kTicks = 10;
  const double kUnfeltN = kTicks * PotentialBlendOptions{}.unfelt_jump_n;  // else nothing would take for ever
  for (const auto& [before, after] : {std::pair{100.0, 108.0}, {100.0, 40.0}, {60.0, 240.0}, {200.0, 20.0}})
    for (const auto& [answers_s, models] :
         {std::pair{0.002, false}, {0.030, false}, {0.002, true}, {0.030, true}}) {
      const std::vector<Vector3> f = felt({{before, 0.1 * before}, {after, -0.1 * after}}, answers_s, models);
      EXPECT_NEAR(f[999].y(), -before * kDepthM, 0.02 * before * kDepthM);
      EXPECT_NEAR(f.back().y(), -after * kDepthM, 0.02 * after * kDepthM) << before << " to " << after;
      double largest = 0;
      for (std::size_t n = 900; n + kTicks < f.size(); ++n)
        largest = std::max(largest, ((f[n + kTicks] - f[n]).norm() - kUnfeltN) / f[n].norm());
      EXPECT_LT(largest, 0.07) << before << " to " << after << " N/m every " << answers_s << " s";
      EXPECT_GT(largest, 0.02) << "it changes at once";
    }
}

}  // namespace
}  // namespace teletact::client
