#include "client/experiment/observer.h"

#include <chrono>
#include <memory>
#include <ostream>
#include <thread>

#include "client/experiment/random.h"

namespace teletact::client {
namespace {

// One number for each trial, whichever is asked for first.
class Chances {
 public:
  explicit Chances(std::uint64_t seed) : random_(seed) {}
  // Of trials in order; those that were skipped have had theirs.
  bool happens(std::size_t number, double probability) {
    for (; drawn_ + 1 < number; ++drawn_) random_.uniform();
    ++drawn_;
    return random_.happens(probability);
  }

 private:
  Random random_;
  std::size_t drawn_ = 0;
};

// What is felt of one interval, in N/m; nothing where the observer ends or the display loses it.
std::optional<double> feel(StimulusDisplay& display, double stiffness_n_m, const Trial& trial,
                           const std::atomic<bool>& stop) {
  constexpr std::chrono::seconds kWithin{30};
  display.present(stiffness_n_m, trial.background_n_m);
  const auto end = std::chrono::steady_clock::now() + kWithin;
  while (!stop && display.lost().empty()) {
    if (display.felt()) return display.felt_n_m();
    if (std::chrono::steady_clock::now() > end)
      throw std::runtime_error("nothing was felt for " + std::to_string(kWithin.count()) + " s (" +
                               display.trouble() + ")");
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  return std::nullopt;
}

}  // namespace

Observer simulated_observer(const Weibull& function, std::uint64_t seed) {
  const auto chances = std::make_shared<Chances>(seed);
  return [=](const Trial& trial, std::size_t number, std::size_t) -> std::optional<bool> {
    return chances->happens(number, probability_harder(function, trial.stimulus_n_m));
  };
}

Observer touching_observer(StimulusDisplay& display, const Weibull& function, std::uint64_t seed,
                           const std::atomic<bool>& stop, std::ostream& out) {
  const auto chances = std::make_shared<Chances>(seed);
  return [=, &display, &stop, &out](const Trial& trial, std::size_t number,
                                    std::size_t of) -> std::optional<bool> {
    out << "trial " << number << " of " << of << std::endl;
    VoidTrials voids;
    while (!stop) {
      std::optional<double> background_n_m, stimulus_n_m;
      if (trial.stimulus_first) stimulus_n_m = feel(display, trial.stimulus_n_m, trial, stop);
      if (!trial.stimulus_first || stimulus_n_m)
        background_n_m = feel(display, trial.background_n_m, trial, stop);
      if (!trial.stimulus_first && background_n_m)
        stimulus_n_m = feel(display, trial.stimulus_n_m, trial, stop);
      if (background_n_m && stimulus_n_m) {
        const double as_felt_n_m = trial.background_n_m * *stimulus_n_m / *background_n_m;
        return chances->happens(number, probability_harder(function, as_felt_n_m));
      }
      if (stop) break;
      const std::string why = display.lost();
      voids.add(why);
      out << "  void, and felt again from the first on: " << why << std::endl;
    }
    return std::nullopt;
  };
}

}  // namespace teletact::client
