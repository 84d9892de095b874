#include "client/experiment/observer.h"

#include <memory>

namespace teletact::client {
Observer simulated_observer(const Weibull& function, std::uint64_t seed) {
  const auto random = std::make_shared<Random>(seed);
  return [=](const Trial& trial, std::size_t, std::size_t) -> std::optional<bool> {
    return random->happens(probability_harder(function, trial.stimulus_n_m));
  };
}

}  // namespace teletact::client
