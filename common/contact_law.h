// The contact law of one fingertip on one layer (T7): the energy of its contact, U(x, z, d), by place on the
// layer and indentation, interpolated from samples. The force is F = -grad U of what is interpolated, so it
// is conservative by construction, whatever the samples are off by, and whoever evaluates it however late.
//
// W = ln U is interpolated over (x, z, s), s = ln d. A column holds samples of W and its derivatives at one
// place, each at depths of its own; W and its derivatives are cubic in s between them. Columns of one z are a
// lane. W is cubic in x between the curves of two columns of a lane, and cubic in z between two lanes: once
// continuously differentiable everywhere, and columns need no common depths, lanes no common x. Of a plane
// there is one lane, which holds at every z; one lane of a solid covers nothing. Above the first depth U is a
// power of d, as it is at first contact; below the last it goes on as one, and that is said.
//
// Shared by the service, which samples it, and the client, which renders it. No allocation, no exceptions.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

namespace teletact {

// Of W = ln(U / 1 J), at one pose.
struct LawSample {
  float log_energy = 0;
  float by_x_1_m = 0;      // dW/dx
  float by_log_depth = 0;  // dW/ds: the power of d that U grows with
  float mixed_1_m = 0;     // d2W/dx ds
  // Across lanes; zero in a plane.
  float by_z_1_m = 0;                                         // dW/dz
  float by_zs_1_m = 0;                                        // d2W/dz ds
  float by_xz_1_m2 = 0;                                       // d2W/dx dz
  float by_xzs_1_m2 = 0;                                      // d3W/dx dz ds
  static constexpr std::size_t kOfAPlane = 4, kOfAnArea = 8;  // numbers
};

struct LawColumn {
  static constexpr std::size_t kMaxRows = 24;
  double x_m = 0;             // scene
  double z_m = 0;             // of its lane; of no meaning in a plane
  double lane_before_m = 0;   // z of the lane before its own, where none is missing between; else its own
  std::uint64_t version = 0;  // of the model that it was sampled from
  // What the interpolated force may be off by around it: a share of it, and so much more.
  float error_share = 0, error_n = 0;
  bool of_area = false;   // of a solid: its lane holds at its z alone
  bool joined = true;     // no column of its lane is missing between the one before it and this one
  bool corrected = true;  // false: a guess, which a better one will replace
  std::uint8_t rows = 0;
  std::array<float, kMaxRows> log_depth{};  // s = ln(d / 1 m), increasing
  std::array<LawSample, kMaxRows> samples{};
};

// The columns between which a place lies: two of one lane in a plane, else two of each of two lanes.
struct LawCell {
  std::array<std::size_t, 4> columns{};  // left and right of the lane before, then of the one after
  std::size_t count = 0;                 // 0: there are none, or some are missing
};

// U and its slopes along x, z and indentation d.
struct LawValue {
  double energy_j = 0;
  double by_x_n = 0, by_d_n = 0, by_z_n = 0;  // the force's components, their signs turned
  std::uint64_t oldest = 0, newest = 0;       // versions of the columns
  double error_n = 0;                         // what the force may be off by, with
  double disagreement_n = 0;  // what it differs by from any of the columns, where versions meet here
                              // or a guess and what is corrected
  bool covered = false;       // false: no cell around the place, or no numbers; all is zero
  bool beyond = false;        // deeper than a column's last sample
  bool corrected = false;     // every column is
};

// `columns`: by z, then x, strictly increasing, each with at least one row.
LawCell cell_at(std::span<const LawColumn> columns, double x_m, double z_m) noexcept;
// No contact (d <= 0): zeros.
LawValue evaluate(std::span<const LawColumn> columns, double x_m, double indentation_m,
                  double z_m = 0) noexcept;

// Whether it may be evaluated: finite, rows within bounds and increasing, U growing with d in every sample.
bool usable(const LawColumn&) noexcept;

}  // namespace teletact
