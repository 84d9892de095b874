#include "service/imaging/modulus/weighed_tissues.h"

#include <array>
#include <stdexcept>
#include <utility>

#include "service/device/cancellation.h"
#include "service/imaging/modulus/pad.h"
#include "service/imaging/modulus/told_tissue.h"
#include "service/imaging/tracking/median.h"

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

constexpr double kLeastStrain = 0.02;   // of the median, that a model shows anywhere: less is a lump to it
constexpr double kDeepestBlockM = 0.4;  // of an image
// What the tissue may be. Where it may end beside the probe, in depths: the next to a place is as likely.
constexpr std::array kBesideDepths{0.0, 0.1, 0.2, 0.35, 0.5, 0.7};
constexpr double kGoesOn = 0.5, kSlides = 0.3, kIsBlock = 0.05;  // beforehand: shares of all, of each, of all
constexpr double kBesideAsStated = 0.9, kAsWideM = 0.5e-3;

constexpr double kVary = 0.15, kTiltStep = 0.1;
constexpr double kFewPercent = 3;  // the same, by all slices, of one that stays where it was in another
constexpr double kSettled = 0.1;   // of ln of elevation and depth: what is linear enough
constexpr int kRoundsOfOthers = 2;

std::uint64_t bytes_of(const TissueAnswer& answer) {
  return sizeof(answer) +
         sizeof(double) * static_cast<std::uint64_t>(answer.log_strain.size() + answer.by_tilt.size());
}

}  // namespace

VectorXd sampled(const VectorXd& of, const CellGrid& cells, const CellGrid& at) {
  const ImageGrid middles{at.columns, at.rows, at.first_x_m, at.row_m / 2, at.spacing_m, at.row_m};
  VectorXd out(static_cast<Index>(at.size()));
  for (std::size_t c = 0; c < at.size(); ++c) out[static_cast<Index>(c)] = at_node(of, cells, middles, 0, c);
  return out;
}

TissueWeigher::TissueWeigher(const Queue& queue, const StrainOptions& strain,
                             std::shared_ptr<StripCache> strips)
    : queue_(queue), strain_(strain), strips_(std::move(strips)) {}

void TissueWeigher::begin() {
  constexpr std::uint64_t kKeptBytes = 4 << 20;  // some 600 answers of a window of 60 x 40 mm
  std::uint64_t bytes = 0;
  for (const auto& known : answers_) bytes += bytes_of(*known);
  if (bytes > kKeptBytes) answers_.clear();
  coarse_solves_ = 0;
}

const TissueAnswer& TissueWeigher::answer(ProbeFace face, bool tilted) {
  face.depth_m = std::max(face.depth_m, face.image_depth_m);  // so that the cells are those of the image
  for (const auto& known : answers_)
    if (known->face == face && !known->block && (!tilted || known->by_tilt.size())) return *known;
  check_cancelled();
  // One that fails counts as well.
  coarse_solves_ += tilted ? 2 : 1;
  const auto tissue = solid(face, kCoarseCellM);
  TissueAnswer out = answer_of(*tissue, face);
  if (tilted) {
    const VectorXd more = -as_measured(tissue->push(pad_cells(face, tissue->cells()), kTiltStep).axial_strain,
                                       tissue->cells(), strain_);
    out.by_tilt = (more.array() / out.log_strain.array().exp() - 1) / kTiltStep;
  }
  return keep(std::move(out));
}

const TissueAnswer& TissueWeigher::block_answer(const ProbeFace& face, const CellGrid& cells) {
  for (const auto& known : answers_)
    if (known->face == face && known->block) return *known;
  check_cancelled();
  coarse_solves_ += kCoarsePerSolve;
  TissueAnswer out = answer_of(*make_probed_block(face, *strips_, kCoarseCellM), face);
  out.block = true;
  out.log_strain = sampled(out.log_strain, out.cells, cells);
  return keep(std::move(out));
}

const FineAnswer& TissueWeigher::fine(const ProbeFace& face, bool with_skin) {
  if (fine_ && fine_->face == face && (!with_skin || fine_->skin)) return *fine_;
  const TissueAnswer& coarse = answer(face, true);
  check_cancelled();
  coarse_solves_ += kCoarsePerSolve * (with_skin ? 1 + kSkinSolves : 1);
  const auto tissue = solid(face, kFineCellM);
  const TissueAnswer level = answer_of(*tissue, face);
  FineAnswer out{face, sampled(level.log_strain, level.cells, coarse.cells) - coarse.log_strain, {}};
  if (with_skin) out.skin = skin_answer(*tissue, level.log_strain, level.log_force, strain_, coarse.cells);
  const std::uint64_t values = coarse.cells.size() * (with_skin ? 1 + kSkinChanges : 1);
  out.held = queue_.account().charge(Place::kHost, "tissues", sizeof(out) + sizeof(double) * values);
  return fine_.emplace(std::move(out));
}

std::shared_ptr<ProbedTissue> TissueWeigher::solid(const ProbeFace& face, double cell_m) {
  Solid& last = solids_[cell_m > kFineCellM];
  if (!last.tissue || last.face != face)
    last.tissue = make_probed_solid(queue_, face, cell_m, std::exchange(last.tissue, {})), last.face = face;
  return last.tissue;
}

TissueAnswer TissueWeigher::answer_of(ProbedTissue& tissue, const ProbeFace& face) const {
  const ProbedTissue::Response level = tissue.push(pad_cells(face, tissue.cells()));
  const VectorXd strain = -as_measured(level.axial_strain, tissue.cells(), strain_);
  std::vector<double> sizes, ratios;
  for (Index c = 0; c < strain.size(); ++c)
    if (strain[c] > 0)
      sizes.push_back(strain[c]), ratios.push_back(-level.lateral_strain[c] / level.axial_strain[c]);
  if (sizes.empty()) throw std::invalid_argument("tissue_depth_m: no strain reaches the image; check it");
  return {face,
          false,
          tissue.cells(),
          strain.cwiseMax(kLeastStrain * median(sizes)).array().log(),
          std::log(level.force_n),
          median(ratios),
          {}};
}

const TissueAnswer& TissueWeigher::keep(TissueAnswer answer) {
  answer.held = queue_.account().charge(Place::kHost, "tissues", bytes_of(answer));
  answers_.push_back(std::make_unique<TissueAnswer>(std::move(answer)));
  return *answers_.back();
}

// To where its elevation, depth and end are linear.
void TissueWeigher::settle(const TissueWindow& w, CandidateTissue& m, int rounds) {
  for (; rounds > 0 && !m.block; --rounds) {
    const ProbeFace face = led_to(w, m, m.fit);
    if (way_to(face, m) < kSettled) return;
    try {
      CandidateTissue other = m;
      other.face = face, other.answer = &answer(face);
      fit(w, other, 0);
      m = std::move(other);
    } catch (const std::invalid_argument&) {  // beyond what is modelled
      return;
    }
  }
}

// Where it was in the nearest slice.
auto TissueWeigher::begin_as_told(const TissueWindow& w, CandidateTissue& m) -> Begun {
  const ToldTissue* told = nearest(w.told, named(w, m));
  if (m.block || told == nullptr) return Begun::kNot;
  ProbeFace face = begun_at(*told, w, m.face);
  if (m.by_beside.size()) face.beside_m = within_place(m, told->beside_m);
  try {
    m.answer = &answer(face), m.face = face;
  } catch (const std::invalid_argument&) {  // beyond what is modelled
    return Begun::kFailed;
  }
  return Begun::kYes;
}

// By an answer more. The one way or the other: it may stand at the edge of what is modelled.
ByLength TissueWeigher::by(double ProbeFace::*length, const CandidateTissue& m) {
  const auto varied = [&](double way) {
    ProbeFace face = m.face;
    face.*length *= std::exp(way);
    const TissueAnswer& other = answer(face);
    return ByLength{(other.log_strain - m.answer->log_strain) / way,
                    (other.log_force - m.answer->log_force) / way};
  };
  try {
    return varied(kVary);
  } catch (const std::invalid_argument&) {
    return varied(-kVary);
  }
}

// Tissue that goes on, to where it is linear.
CandidateTissue TissueWeigher::reference(TissueWindow& w, const ProbeFace& start, int rounds) {
  CandidateTissue out{start};
  const auto linear = [&] {
    w.face = out.face;
    out.answer = &answer(w.face, true);
    w.by_tilt = out.answer->by_tilt;
    out.by_elevation = by(&ProbeFace::elevation_m, out), out.by_depth = by(&ProbeFace::depth_m, out);
    if (!(w.face.pad_m > 0)) return;
    w.by_pad_thickness = by(&ProbeFace::pad_m, out);
    ProbeFace stiffer = w.face;
    stiffer.pad_log += kVary;
    w.by_pad_modulus = (answer(stiffer).log_strain - out.answer->log_strain) / kVary;
  };
  linear();
  for (int round = 1;; ++round) {
    fit(w, out, 0);
    if (round == rounds) return out;
    const TissueWindow last = w;
    CandidateTissue settled = out;
    settle(w, out, 1);
    if (out.face == settled.face) return out;
    try {
      linear();
    } catch (const std::invalid_argument&) {  // its neighbours are beyond what is modelled
      w = last;
      return settled;
    }
  }
}

// What else the tissue may be.
void TissueWeigher::consider_others(const TissueWindow& w, std::vector<CandidateTissue>& models) {
  // What ends that far away is as if it went on; what ends that near, as if it were as wide as the probe.
  const bool stated = w.beside_m.has_value(),
             wide = stated && *w.beside_m - 2 * w.beside_std_m >= kBesideDepths.back() * w.face.depth_m;
  const double stated_m = w.beside_m.value_or(0) < kAsWideM ? 0 : *w.beside_m;
  const double others = stated ? 1 - kBesideAsStated : 1, places = kBesideDepths.size(),
               end = (1 - kGoesOn - kIsBlock) / places;
  models[0].log_prior = std::log((kGoesOn * others + (wide ? kBesideAsStated : 0)) * (1 - kSlides));
  // A face that touches in part looks tilted, and sides would explain some of it.
  const bool tilted = std::abs(models[0].fit.at[kTilt]) > kMaxTiltOfSides;
  const auto consider = [&](CandidateTissue model, double prior) {
    try {
      model.answer = model.block ? &block_answer(model.face, w.cells) : &answer(model.face);
      model.log_prior = std::log(prior);
      models.push_back(std::move(model));
    } catch (const std::invalid_argument&) {  // beyond what is modelled
    }
  };
  // Of the odds so far, at the scale of what the best leaves.
  const auto far_behind = [&](CandidateTissue& last) {
    fit(w, last, 0);
    double best = -HUGE_VAL, rest = HUGE_VAL;
    for (const CandidateTissue& m : models) rest = std::min(rest, m.fit.rest);
    for (CandidateTissue& m : models) fit(w, m, std::hypot(rest, kModelLog)), best = std::max(best, m.odds());
    return last.odds() < best - kWorthless;
  };
  const auto with = [&](double beside_m, bool slides, double step_m = 0) {
    CandidateTissue model{w.face};
    model.face.beside_m = model.place_m = beside_m, model.face.slides = slides, model.step_m = step_m;
    model.by_elevation = models[0].by_elevation, model.by_depth = models[0].by_depth;
    return model;
  };
  if (w.face.image_depth_m < kDeepestBlockM) {
    CandidateTissue block = with(0, false);
    block.block = true, block.face.elevation_m = std::exp(w.elevation.log);
    consider(std::move(block), kIsBlock * others);
  }
  for (const bool slides : {false, true}) {
    const double of_support = slides ? kSlides : 1 - kSlides;
    if (tilted) {
      if (stated && !wide) consider(with(stated_m, slides), kBesideAsStated * of_support);
      continue;
    }
    // From the outermost inwards, until one explains less than the next outer one and far less than the best.
    const std::size_t first = models.size();
    for (std::size_t k = kBesideDepths.size(); k-- > 0;) {
      const bool inner = k + 1 < kBesideDepths.size();
      const double way =
          k > 0 ? (kBesideDepths[inner ? k + 1 : k] - kBesideDepths[k - 1]) / (inner ? 2 : 1) : 0;
      const std::size_t count = models.size();
      consider(with(w.face.depth_m * kBesideDepths[k], slides, w.face.depth_m * way),
               end * of_support * others);
      if (models.size() == count) continue;
      const bool far = far_behind(models.back()), reached = !stated || models.back().place_m <= stated_m;
      if (far && reached && count > first && models[count].odds() < models[count - 1].odds()) break;
    }
    const auto first_place = models.begin() + static_cast<std::ptrdiff_t>(first);
    std::reverse(first_place, models.end());
    const std::size_t last = models.size() - 1;
    // As wide as the probe is cut so: that place stays.
    for (std::size_t k = first; k < models.size() && last > first; ++k) {
      if (!(models[k].step_m > 0)) continue;
      const CandidateTissue &before = models[std::max(k, first + 1) - 1],
                            &after = models[std::min(k + 1, last)];
      const double steps = (after.face.beside_m - before.face.beside_m) / models[k].step_m;
      models[k].by_beside = (after.answer->log_strain - before.answer->log_strain) / steps;
      models[k].force_by_beside = (after.answer->log_force - before.answer->log_force) / steps;
    }
    if (!stated || wide || last <= first) continue;
    // Its deviation moves it as the nearest place's step would.
    const CandidateTissue& near =
        *std::ranges::min_element(first_place + (models[first].step_m > 0 ? 0 : 1), models.end(), {},
                                  [&](const CandidateTissue& m) { return std::abs(m.place_m - stated_m); });
    const double std_m = w.beside_std_m > 0 ? w.beside_std_m : kLogStated * stated_m;
    CandidateTissue as_stated = with(stated_m, slides, std_m / kOfGridStep);
    as_stated.by_beside = near.by_beside * as_stated.step_m / near.step_m;
    as_stated.force_by_beside = near.force_by_beside * as_stated.step_m / near.step_m;
    consider(std::move(as_stated), kBesideAsStated * of_support);
  }
}

WeighedTissues TissueWeigher::weigh(TissueWindow window, const ProbeFace& start, bool all, int rounds) {
  WeighedTissues out{std::move(window), {}};
  const TissueWindow& w = out.window;
  // That of the slices before, so that places beside the probe are theirs. Its failure takes a round's
  // solves.
  if (const ToldTissue* told = nearest(w.told, {})) try {
      out.models.push_back(reference(out.window, begun_at(*told, w, start), 1));
    } catch (const std::invalid_argument&) {  // beyond what is modelled, here
      rounds = std::max(1, rounds - 1);
    }
  if (out.models.empty()) out.models.push_back(reference(out.window, start, rounds));
  if (!all) return out;
  consider_others(w, out.models);
  for (CandidateTissue& m : out.models) fit(w, m, 0);
  const double scale = std::hypot(out.least().fit.rest, kModelLog);
  for (CandidateTissue& m : out.models) fit(w, m, scale);
  const auto by_all = [&](const CandidateTissue& m) {
    return m.odds() + told_odds(w.told, w.face, named(w, m));
  };
  const double best = out.best(), best_by_all = by_all(*std::ranges::max_element(out.models, {}, by_all));
  for (CandidateTissue& m : out.models) {
    if (!(m.odds() > best - kWorthless)) continue;
    const bool counts = by_all(m) > best_by_all - kFewPercent;
    const Begun begun = begin_as_told(w, m);
    if (!m.block && m.face.beside_m < kSkinBeside * m.face.depth_m) try {
        m.by_elevation = by(&ProbeFace::elevation_m, m);
      } catch (const std::invalid_argument&) {  // beyond what is modelled: about as the reference's
      }
    fit(w, m, scale);
    const int spent = begun == Begun::kNot ? 0 : 1;
    if (counts || begun != Begun::kYes) settle(w, m, kRoundsOfOthers - spent);
  }
  return out;
}

int TissueWeigher::max_coarse_solves_of_reference(bool pad) {
  // Level, tilted and two neighbours, or four; and where it moves to. Of a pad two or three more.
  const int once = pad ? 9 : 6;
  return once + (once + 1) * (kRoundsOfReference - 1);
}

int TissueWeigher::max_coarse_solves(bool all, bool pad) {
  constexpr int kOthers = 2 * (static_cast<int>(kBesideDepths.size()) + 1);
  // Those beyond: of the first guess of the pad's modulus.
  return (pad ? 2 : 0) + (all ? max_coarse_solves_of_reference(pad) + kCoarsePerSolve + 3 * kOthers +
                                    (1 + kOthers) * kRoundsOfOthers
                              : (pad ? 9 : 6));
}

}  // namespace teletact::service
