// Samples the contact law of one fingertip on one layer of a model (T7): columns along the layer, as few as
// keep the interpolated force within a tolerance of the model's, and what each may be off by, as the poses
// around it that it was not made from have shown. What could not be tried is not claimed.
#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "common/contact_law.h"
#include "service/base/choices.h"
#include "service/contact/contact_laws.h"
#include "service/contact/touch_model.h"

namespace teletact::service {

class LawSampler final : public LawSampling {
 public:
  // Over [begin_m, end_m] of the layer's x, what is nearest to `near_m` first. `touched` is that layer,
  // ready. Throws nothing of the model's: where it cannot be touched, columns end above or are missing.
  LawSampler(std::shared_ptr<TouchedLayer> touched, const Layer&, const Fingertip&, double begin_m,
             double end_m, double near_m);

  // Works on one cell at least.
  bool advance(Clock::time_point until) override;
  // Those that no further work will alter.
  std::vector<LawColumn> columns() const override;
  std::size_t solves() const { return solves_; }  // contacts solved, those that only check too

 private:
  // A column, and the cell from it to the next one.
  struct Place {
    LawColumn column;        // no rows: not sampled yet, or the model cannot be touched there
    std::size_t halved = 0;  // how often the cell was
    bool sampled = false, refined = false, settled = false;
    bool averaged = false;  // its samples are, over the ripple of the mesh
    double off = 0;         // of the force, in tolerances: the worst that was measured for it
  };
  struct Contact {  // of one pose, as the model answers it
    LawSample sample;
    double by_x_n = 0, by_d_n = 0;
  };
  struct Tried {  // a pose of a cell that the law does not hold
    double x_m, d_m;
    Contact contact;
  };
  std::optional<Contact> touch(double x_m, double d_m, double to_each_side_m = 0);
  std::optional<Contact> touch(const Place&, double d_m);  // as its samples are
  double kept(const Place&) const;  // what its cell may be off by, in tolerances, without being halved
  double off(const LawValue&, const Contact&) const;  // of the force, in tolerances
  bool known(std::size_t place) const;
  void sample(Place&, const LawColumn& like);
  void refine_rows(Place&);
  void average(std::size_t cell, std::vector<Tried>&);
  std::vector<Tried> try_cell(std::size_t cell, std::size_t begin, std::size_t end);
  double worst(std::size_t cell, const std::vector<Tried>&) const;
  void settle(std::size_t cell);

  const std::shared_ptr<TouchedLayer> touched_;
  const Layer layer_;
  const Fingertip tip_;
  const double near_m_;
  const std::span<const double> kept_;  // by how often a cell was halved
  LawColumn first_rows_;                // the depths that every column has
  std::vector<Place> places_;           // by x
  std::size_t solves_ = 0;
};

}  // namespace teletact::service
