// What lets an observer feel one stiffness after the other: springs of this machine (spring_display.h), or
// tissue on a service (client/stimuli). What is next is shown once the finger has been lifted.
#pragma once

#include <stdexcept>
#include <string>

namespace teletact::client {

// What shows the stimuli is gone, and the experiment with it; the answers so far are kept.
struct DisplayLost : std::runtime_error {
  using std::runtime_error::runtime_error;
};

class StimulusDisplay {
 public:
  static constexpr double kPressedM = 0.0005;  // pressed: deeper than this
  static constexpr double kFeltS = 0.3;        // felt: pressed for so long with the whole force on

  virtual ~StimulusDisplay() = default;
  // Both in N/m; an inclusion's background is beside it, and without one nowhere. Throws
  // std::invalid_argument naming the field where it cannot be shown, DisplayLost where nothing can any more.
  virtual void present(double stiffness_n_m, double background_n_m) = 0;
  virtual bool has_inclusion() const noexcept = 0;
  // What was presented last has been felt, an inclusion in its middle.
  virtual bool felt() const noexcept = 0;
  // Force over indentation (N/m) while it was, in the mean; 0: it was not yet.
  virtual double felt_n_m() const = 0;
  // Why there is no force now; empty while there is.
  virtual std::string trouble() const = 0;
  // After a fault force comes back only for this: when the finger is out of contact.
  virtual void ask_for_force() noexcept = 0;
  // Why what was presented last is not felt to its end, whatever is waited for; empty while it may be.
  virtual std::string lost() const { return ""; }
};

// What was felt of one stimulus, tick by tick, with the whole force on.
class FeltTicks {
 public:
  void add(double force_n, double depth_m) { ++ticks_, sum_n_m_ += force_n / depth_m; }
  bool felt(double period_s) const { return ticks_ * period_s >= StimulusDisplay::kFeltS; }
  double mean_n_m() const { return ticks_ > 0 ? sum_n_m_ / ticks_ : 0; }

 private:
  unsigned ticks_ = 0;
  double sum_n_m_ = 0;
};

// Trials that were begun and could not be felt to their end.
class VoidTrials {
 public:
  static constexpr unsigned kMax = 3;  // in a row
  // One more, for that reason. Throws DisplayLost when it is one too many.
  void add(const std::string& why) {
    if (++in_a_row_ >= kMax)
      throw DisplayLost("the trial could not be felt " + std::to_string(kMax) + " times in a row: " + why);
  }

 private:
  unsigned in_a_row_ = 0;
};

}  // namespace teletact::client
