// Samples the contact law of one fingertip on one layer of a model (T7): columns along the layer, as few as
// keep the interpolated force within a tolerance of the model's.
#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <vector>

#include "law/contact_law.h"
#include "service/contact/touch_model.h"
#include "service/plan/choices.h"

namespace teletact::service {

// What an interpolated force may be off by: a share of it and a floor, together.
struct LawTolerance {
  double share = choices::kLawShare;
  double floor_n = choices::kLawFloor;
};

// Of a law that was sampled.
struct LawReport {
  std::size_t samples = 0;  // that it is made of
  std::size_t solves = 0;   // contacts solved for it, those that only checked it too
  double worst_error =
      0;  // of the force at poses that it does not hold, in tolerances; those left over 1 too
};

// One thread at a time.
class LawSampler {
 public:
  using Clock = TouchedLayer::Clock;
  // Over [begin_m, end_m] of the layer's x. `touched` is that layer, ready. Throws nothing of the model's:
  // where it cannot be touched, columns end above or are missing.
  LawSampler(std::shared_ptr<TouchedLayer> touched, const Layer&, const Fingertip&, double begin_m,
             double end_m, const LawTolerance& = {});

  // Works on what is nearest to x, until all is done or the next contact would begin after `until`. True when
  // done.
  bool advance(double x_m, Clock::time_point until);
  // Made so far, by x. Between two of them the law may still be refined.
  const std::vector<LawColumn>& columns() const { return columns_; }
  const LawReport& report() const { return report_; }

 private:
  struct Cell {
    double begin_m, end_m;  // columns stand at both
    int halvings;
  };
  struct Contact {  // of one pose, as the model answers it
    LawSample sample;
    double by_x_n, by_d_n;
  };
  std::optional<Contact> touch(double x_m, double log_depth);
  double error(const Contact&, double by_x_n, double by_d_n) const;
  LawColumn column_at(double x_m);
  void refine_rows(LawColumn&);
  void check(const Cell&);
  void insert(const LawColumn&);

  const std::shared_ptr<TouchedLayer> touched_;
  const Layer layer_;
  const Fingertip tip_;
  const LawTolerance tolerance_;
  std::vector<double> wanted_;  // x of columns that every law has
  std::vector<Cell> cells_;     // still to be checked
  std::vector<LawColumn> columns_;
  LawReport report_;
};

}  // namespace teletact::service
