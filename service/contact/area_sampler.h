// Samples the contact law of one fingertip over an area of solid tissue (T7.2c): lanes of columns, all as far
// from each other, and what each may be off by, as poses between them have shown. All of it first by the
// guess of layered tissue, then corrected; both from the finger outwards.
#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <optional>
#include <vector>

#include "common/contact_law.h"
#include "service/contact/contact_laws.h"
#include "service/contact/touch_model.h"

namespace teletact::service {

class AreaSampler final : public LawSampling {
 public:
  // Over the whole region, a solid's, what is nearest to `near_m` first. `touched`: the layer, for a law.
  // Where it cannot be touched columns end above, are missing, or stay guesses.
  AreaSampler(std::shared_ptr<TouchedLayer> touched, const Layer&, const Fingertip&, const Region&,
              const Vector3& near_m);

  // Works on one contact at least, or on a cell's: on a fine block each takes tens of milliseconds.
  // Throws DeviceError, MemoryRefused.
  bool advance(Clock::time_point until) override;
  std::vector<LawColumn> columns() const override;
  std::size_t solves() const { return solves_; }  // contacts answered, those that only check too
  bool guessed() const { return correcting_; }    // every column has its guess, at least

 private:
  struct Place {
    LawColumn sampled;           // of this turn, where it is
    bool is_sampled = false;     // in this turn
    double off = 0;              // of the force, in tolerances: the worst that was measured for it
    double known_to = 0;         // what the model states of its forces, over them: the worst
    std::size_t cells_left = 0;  // around it that were not tried in this turn
    LawColumn shown;             // no rows: nothing is
  };
  struct Contact {  // of one pose, as the model answers it
    double energy_j = 0;
    Vector3 by_n{};    // its slopes along x, d and z
    Vector3 curved{};  // and by x and d, z and d, x and z
    double known_to = 0;
    LawSample at(double d_m) const;
  };
  using Corners = std::array<std::size_t, 4>;
  std::optional<Contact> touch(double x_m, double z_m, double d_m);
  std::optional<Contact> averaged(double x_m, double z_m, double d_m);
  void begin_turn(bool correcting);
  void begin(Place&);
  void sample(Place&);
  void try_cell(const Corners&);
  void show(Place&);
  std::vector<Corners> cells_around(std::size_t place) const;

  const std::shared_ptr<TouchedLayer> touched_;
  const Layer layer_;
  const Fingertip tip_;
  std::vector<double> x_m_, z_m_;   // of columns, of lanes
  std::vector<Place> places_;       // lane by lane
  std::vector<std::size_t> order_;  // of places, the nearest first
  std::size_t next_ = 0;            // of them, in this turn
  std::size_t rows_left_ = 0;       // of the place before that
  std::vector<std::optional<Contact>> rows_;
  std::vector<Corners> untried_;  // cells that are sampled in this turn
  bool correcting_ = false;       // the second turn
  std::size_t solves_ = 0;
};

}  // namespace teletact::service
