#include <chrono>

#include "bench/suites/soak/soak.h"
#include "client/acquire/estimate_client.h"
#include "client/link/channel.h"

namespace teletact::bench::soak {
namespace {

constexpr double kLongModulusS = 60;  // the contract's longest
constexpr int kGreedyCalls = 16;
constexpr auto kGreedyPause = std::chrono::milliseconds(50), kLookEvery = std::chrono::milliseconds(10);

}  // namespace

std::unique_ptr<Rogue> start_greedy(const Service& service, const std::string& scene_id,
                                    const std::vector<client::FramePair>& pairs, const Pause& pause) {
  auto rogue = std::make_unique<Rogue>();
  const auto channel = client::make_channel(service.address, service.credentials, "soak-greedy");
  const auto estimators = std::make_shared<std::vector<std::unique_ptr<client::EstimateClient>>>();
  for (int k = 0; k < kGreedyCalls; ++k)
    estimators->push_back(std::make_unique<client::EstimateClient>(channel, 0));
  // A pause is one: on a busy machine the service would work at a long call until late into it.
  rogue->threads.emplace_back([&rogue = *rogue, estimators, &pause] {
    while (!rogue.stop) {
      if (pause)
        for (const auto& estimator : *estimators) estimator->cancel();
      std::this_thread::sleep_for(kLookEvery);
    }
    for (const auto& estimator : *estimators) estimator->cancel();
  });
  for (int k = 0; k < kGreedyCalls; ++k)
    rogue->threads.emplace_back([&rogue = *rogue, estimators, scene_id, k, &pairs, &pause] {
      client::EstimateClient& estimator = *(*estimators)[static_cast<std::size_t>(k)];
      const client::FramePair& pair = pairs[static_cast<std::size_t>(k) % pairs.size()];
      v1::Acquisition acquisition = published(pair, scene_id, 0);
      acquisition.set_modulus_time_limit_s(kLongModulusS);
      for (bool wide = k % 2 == 0; !rogue.stop; wide = !wide) try {
          while (!rogue.stop && pause) std::this_thread::sleep_for(kLookEvery);
          acquisition.set_max_strain(wide ? 0.08 : 0.04);
          estimator.estimate(acquisition, pair.pre, pair.post, {}, rogue.stop);
          rogue.statuses.add("OK");
        } catch (const client::ServiceError& error) {
          rogue.statuses.add(code_in(error));
          std::this_thread::sleep_for(kGreedyPause);
        }
    });
  return rogue;
}

}  // namespace teletact::bench::soak
