#include "service/imaging/modulus/probe_fit.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <stdexcept>
#include <utility>

#include "service/imaging/modulus/modulus.h"
#include "service/imaging/modulus/pad.h"
#include "service/imaging/modulus/tissue_words.h"
#include "service/imaging/modulus/told_tissue.h"
#include "service/imaging/tracking/median.h"

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kCommonLog = 0.03;  // the model's own, alike in all cells
// Tissue that is taken to go on ends somewhere from 0.7 depths beside the face on: the mean over ln of the
// way of ln of the force that it then lacks (0.08 at 0.8 depths, 0.035 at 1.1, 0.015 at 1.6).
constexpr double kEndsSomewhereLog = 0.022;

// Beforehand: ln of what is not stated, about the usual.
constexpr double kUsualElevationM = 0.010, kLogUsualElevation = 0.6;
constexpr double kUsualDepths = 1.5, kLogUsualDepth = 0.4;  // of what the image shows
constexpr double kMinElevationM = 3e-3, kMaxElevationM = 0.040, kMaxDepths = 3;

constexpr double kFarBeyondImage = 3;  // deviations of a depth that is stated: that is another start
// Of ln of the face's length: the strain alone leads so far from what is stated.
constexpr double kAstray = kLinear;
// Of ln E where the strain contradicts what is stated: a face that is stated 75 % too long puts it off by up
// to 0.26.
constexpr double kContradictedLog = 0.15;
constexpr std::size_t kMostBetween = 4;  // changes that tissues differ by: a fifth brings under 1 % more
constexpr std::size_t kMostChanges = 8;  // of what each leaves open of itself
constexpr double kSpreadOfDepth = 0.29;  // deviation of the cells' depth, in images

constexpr double kWellExplained = 0.08;  // of the strain, unexplained
// Standard deviation of ln E where other tissue was not tried: tissue that ends 0.5 to 0.75 depths beside
// the probe reads 0.79 to 0.89 of the truth, what ends nearer less.
constexpr double kUnweighedLog = 0.3, kWellExplainedLog = 0.1;  // the second: of what explains all but that
constexpr double kMaxGrading = 1.1;  // of ln E from the face to the bottom of the image: more is no tissue

KnownLength elevation_known(const TissueExtent& tissue, double elevation_m) {
  const double low = std::log(kMinElevationM), high = std::log(kMaxElevationM);
  if (!(elevation_m > 0)) return {false, std::log(kUsualElevationM), kLogUsualElevation, low, high};
  const double std_m = tissue.probe_elevation_std_m, log = std::log(elevation_m);
  return {true, log, std_m > 0 ? std_m / elevation_m : kLogStated, std::min(low, log), std::max(high, log)};
}

KnownLength depth_known(const TissueExtent& tissue, double depth_m, double image_m) {
  const double low = std::log(image_m), high = std::log(kMaxDepths * image_m);
  if (!tissue.depth_stated) return {false, std::log(kUsualDepths * image_m), kLogUsualDepth, low, high};
  const double log = std::log(depth_m);
  return {true, log, tissue.depth_std_m > 0 ? tissue.depth_std_m / depth_m : kLogStated, std::min(low, log),
          std::max(high, log)};
}

MatrixXd columns_of(const std::vector<VectorXd>& fields) {
  MatrixXd out(fields[0].size(), std::ssize(fields));
  for (Index n = 0; const VectorXd& field : fields) out.col(n++) = field;
  return out;
}

TissueWindow with_open_face(TissueWindow w) {
  w.elevation.stated = false, w.elevation.deviation = kLogUsualElevation, w.told.clear();
  return w;
}

}  // namespace

ProbeFitter::ProbeFitter(const Queue& queue, const StrainOptions& strain, std::shared_ptr<StripCache> strips)
    : strips_(strips), weigher_(queue, strain, std::move(strips)) {}

int ProbeFitter::max_solves(FitEffort effort, bool pad) {
  const bool all = effort != FitEffort::kUsual, others = effort == FitEffort::kAllStarts;
  const int coarse = kCoarsePerSolve * (all && !pad ? 1 + kSkinSolves : 1) +
                     (others ? 3 : 1) * TissueWeigher::max_coarse_solves(all, pad);
  return (coarse + kCoarsePerSolve - 1) / kCoarsePerSolve;
}

// Whether the strain alone leads far from the face that is stated. No solves.
bool ProbeFitter::astray(const WeighedTissues& start) const {
  if (!start.window.elevation.stated) return false;
  const TissueWindow open = with_open_face(start.window);
  const double likely = start.best() - kWorthless;
  return std::ranges::any_of(start.models, [&](CandidateTissue m) {
    if (m.block || m.odds() < likely) return false;
    weigher_.fit(open, m, 0);
    return std::abs(m.fit.at[kElevation]) > kAstray;
  });
}

// Where it leads then, if that contradicts what is stated.
std::optional<ProbeFace> ProbeFitter::far_from_stated(const WeighedTissues& start) {
  try {
    const WeighedTissues open =
        weigher_.weigh(with_open_face(start.window), start.models[0].face, false, kRoundsOfReference);
    const ProbeFace& face = open.models[0].face;
    if (start.window.elevation.contradicted(face.elevation_m)) return face;
  } catch (const std::invalid_argument&) {  // beyond what is modelled
  }
  return {};
}

ProbeFit ProbeFitter::fit(const ModulusInput& in, double elevation_m, double sign, FitEffort effort) {
  weigher_.begin();
  const Measured& measured = in.measured;
  const double top_m = in.tissue.pad ? 0 : top_of(measured), depth_m = in.tissue.depth_m - top_m;
  if (!(depth_m > 0))
    throw std::invalid_argument(
        fmt::format("tissue_depth_m: the tissue ends {:.1f} mm deep, but nothing was tracked above {:.1f} mm",
                    1e3 * in.tissue.depth_m, 1e3 * top_m));
  const double shown_m = bottom_of(measured) - top_m,
               image_m = in.tissue.depth_stated || in.tissue.doubted_depth_m > 0 ? std::min(shown_m, depth_m)
                                                                                 : shown_m;
  TissueWindow w{in.tissue.beside_m, in.tissue.beside_std_m, elevation_known(in.tissue, elevation_m),
                 depth_known(in.tissue, depth_m, image_m)};
  if (const std::optional<double> ratio = lateral_ratio(measured)) w.lateral_ratio = *ratio;
  const double pad_m = in.tissue.pad ? in.tissue.pad->thickness_m : 0;
  if (pad_m > 0) w.pad = pad_known(*in.tissue.pad, image_m);
  const auto usual = [&](const TissueWindow& of) {
    ProbeFace face{in.window_width_m, std::exp(of.elevation.log), std::exp(of.depth.log), image_m,
                   in.tissue.poisson_ratio};
    face.pad_m = pad_m, face.pad_log = of.pad_log;
    return face;
  };
  const TissueAnswer& first = weigher_.answer(usual(w), true);
  w.cells = first.cells;
  w.measured = cell_strains(measured, w.cells, top_m, sign);
  w.places = w.cells.spacing_m * w.cells.row_m / kAlikeM2;
  leave_out(first.log_strain, w.cells, pad_m, 0, w.measured.observed);
  if (pad_m > 0)
    w.pad_log = first_pad_log(first.log_strain, w.measured.log_strain, w.measured.observed, w.cells, pad_m);
  w.of_depth.resize(first.log_strain.size());
  for (std::size_t c = 0; c < w.cells.size(); ++c)
    w.of_depth[static_cast<Index>(c)] = w.cells.y_m(c) < pad_m ? 0 : w.cells.y_m(c) / image_m - 0.5;

  const bool all = effort != FitEffort::kUsual;
  w.as_stated = !all;
  const FineAnswer& fine = weigher_.fine(usual(w), all && !in.tissue.pad);
  w.finer = fine.finer;
  w.skin = skin_known(in.tissue.surface, cells_under(usual(w), kFineCellM).row_m);
  if (fine.skin) w.by_skin = *fine.skin;
  // Tissue that ends may be shallower than is stated where tissue that goes on is not.
  const bool deep = w.depth.stated && w.depth.log - std::log(image_m) > kFarBeyondImage * w.depth.deviation;
  const bool all_starts = effort == FitEffort::kAllStarts;
  const char* untried = !all ? "another depth, tissue that ends beside the probe, and one that slides"
                        : deep && !all_starts ? "shallower tissue"
                                              : "";
  std::vector<WeighedTissues> starts;
  const auto weigh = [&]() -> TogetherWeighed {
    starts = {weigher_.weigh(w, usual(w), all, all ? kRoundsOfReference : 1)};
    if (deep && all_starts) {
      ProbeFace shallow = usual(w);
      shallow.depth_m = image_m;
      try {
        starts.insert(starts.begin(), weigher_.weigh(w, shallow, true, 1));
      } catch (const std::invalid_argument&) {  // beyond what is modelled
      }
    }
    if (all && w.told.empty() && !in.tissue.pad && astray(starts.back())) {
      if (!all_starts)
        untried = deep ? "shallower tissue, and another face" : "another face";
      else if (const std::optional<ProbeFace> far = far_from_stated(starts.back()))
        try {
          starts.insert(starts.begin(), weigher_.weigh(w, *far, true, 1));
        } catch (const std::invalid_argument&) {  // beyond what is modelled
        }
    }
    if (all) {
      const CandidateTissue& least = std::ranges::min_element(starts, {}, [](const WeighedTissues& s) {
                                       return s.least().fit.rest;
                                     })->least();
      const double scale = std::hypot(least.fit.rest, kModelLog),
                   places = w.cells.spacing_m * w.cells.row_m /
                            std::max(kAlikeM2, alike_m2(least.fit.left, w.cells, scale));
      for (WeighedTissues& start : starts) {
        start.window.places = places;
        for (CandidateTissue& m : start.models) weigher_.fit(start.window, m, scale);
      }
    }
    if (all && !in.tissue.pad) return weigh_together(weigher_, in.told, starts);
    weigh_together(starts);
    return {};
  };
  // What does not agree with other slices is searched as if they had not told where to begin, by the solves
  // of another start.
  if (all_starts && !in.tissue.pad && !deep) w.told = in.told;
  TogetherWeighed weighed = weigh();
  if (weighed.heeded != Heeded::kAll && !w.told.empty()) w.told.clear(), weighed = weigh();
  ProbeFit out = publish(starts, in, sign, all, untried);
  out.told = std::move(weighed.told);
  if (weighed.heeded == Heeded::kAll)
    out.words += fmt::format("; agrees with other slices ({})", in.told.size());
  else if (weighed.heeded == Heeded::kContradicted)
    out.words += fmt::format("; disagrees with other slices ({}), which are ignored", in.told.size());
  out.top_m = top_m;
  if (top_m > 0)
    out.words +=
        fmt::format("; the tissue is taken to begin {:.1f} mm deep", 1e3 * (in.tissue.surface_m + top_m));
  out.solves = (weigher_.coarse_solves() + kCoarsePerSolve - 1) / kCoarsePerSolve;
  return out;
}

ProbeFit ProbeFitter::publish(const std::vector<WeighedTissues>& starts, const ModulusInput& in, double sign,
                              bool all, const char* untried) {
  // By kind: what ends here or there ends.
  std::map<std::array<int, 3>, WeighedKind> kinds;
  for (int start = 0; const WeighedTissues& weighed : starts) {
    for (const CandidateTissue& m : weighed.models) {
      const auto [ends, slides] = kind_of(m);
      WeighedKind& kind =
          kinds.try_emplace({ends, slides, start}, WeighedKind{&m, &weighed.window, 0}).first->second;
      kind.weight += m.weight;
      if (m.weight > kind.of->weight) kind.of = &m;
    }
    ++start;
  }
  std::vector<WeighedKind> order;
  order.reserve(kinds.size());
  for (const auto& [_, kind] : kinds) order.push_back(kind);
  std::ranges::sort(order, std::ranges::greater{}, [](const WeighedKind& k) { return k.weight; });
  const CandidateTissue& likeliest = *order[0].of;
  const TissueWindow& w = *order[0].window;

  // In the cells of the likeliest.
  ProbeFit out;
  out.face = likeliest.face;
  out.tissue = likeliest.block ? std::shared_ptr<ProbedTissue>(make_probed_block(out.face, *strips_))
                               : weigher_.solid(out.face, kFineCellM);
  const CellGrid& cells = out.tissue->cells();
  const auto in_cells = [&](const VectorXd& coarse) { return sampled(coarse, w.cells, cells); };
  // What lies under a pad has no skin: its strain is measured.
  const bool pad = out.face.pad_m > 0, by_pad = pad && !in.force;
  out.measured = cell_strains(in.measured, cells, pad ? 0 : top_of(in.measured), sign);
  const VectorXd of_pad = pad_cells(out.face, cells);
  leave_out(in_cells(likeliest.answer->log_strain) + of_pad, cells, out.face.pad_m, kPadEdgeM,
            out.measured.observed);
  out.by_tilt = in_cells(w.by_tilt);
  out.lateral_ratio = likeliest.answer->lateral_ratio;

  // Of coarse cells, whose period is another, on tissue that goes on: about the same for all.
  double log_share = 0;
  if (in.force && std::ranges::any_of(order, [](const WeighedKind& kind) {
        return kind.of->face.goes_on() && kind.weight > kLeastWeight;
      }))
    log_share = std::log(weigher_.solid(w.face, kCoarseCellM)->force_share());
  // An absolute modulus goes as the strain that a force brings, a relative one as the strain beside its mean,
  // or beside that of a pad.
  const VectorXd beside = by_pad ? in_pad(w.measured.observed, w.cells, out.face.pad_m) : w.measured.observed;
  const auto of_modulus = [&](VectorXd log_strain, double log_force) {
    log_strain.array() -= in.force ? log_force : beside.dot(log_strain) / beside.sum();
    return log_strain;
  };
  const std::size_t skins = pad ? 0 : kSkinChanges;
  // Of the skin: in the mean over all tissues; beforehand, where the fit is not of it.
  const auto skin_of = [&](const CandidateTissue& m, std::size_t k) {
    return m.with_skin ? m.with_skin->at[m.with_skin->at.size() - static_cast<Index>(kSkinChanges - k)]
                       : w.skin.mean[k];
  };
  const auto each = [&](const auto& work) {
    for (const WeighedTissues& weighed : starts)
      for (const CandidateTissue& m : weighed.models)
        if (m.weight > kLeastWeight) work(weighed.window, m);
  };
  std::array<double, kSkinChanges> skin{};
  double weights = 0;
  each([&](const TissueWindow&, const CandidateTissue& m) {
    weights += m.weight;
    for (std::size_t k = 0; k < skins; ++k) skin[k] += m.weight * skin_of(m, k);
  });
  out.above = of_pad;
  for (std::size_t k = 0; k < skins; ++k) out.above += (skin[k] /= weights) * skin_cells(cells, k);
  const auto found = [&](const TissueWindow& about, const CandidateTissue& m, double share = 1) {
    VectorXd log_strain = m.answer->log_strain;
    if (!m.block) log_strain += about.finer;
    const double somewhere = about.beside_m ? 0 : share * kEndsSomewhereLog;
    double log_force = m.answer->log_force - (m.face.goes_on() ? log_share + somewhere : 0);
    const auto add = [&](Index column, const VectorXd& of_strain, double of_force) {
      const double at = share * (m.with_skin ? *m.with_skin : m.fit).at[column];
      log_strain += at * of_strain, log_force += at * of_force;
    };
    if (!m.block && all) {
      add(kElevation, m.by_elevation.strain, m.by_elevation.force);
      add(kDepth, m.by_depth.strain, m.by_depth.force);
      if (m.by_beside.size()) add(kBeside, m.by_beside, m.force_by_beside);
      if (pad) add(pad_column(m.fit), about.by_pad_thickness.strain, about.by_pad_thickness.force);
      for (std::size_t k = 0; k < skins; ++k) {
        const double more = share * (skin_of(m, k) - skin[k]);
        log_strain += more * about.by_skin.log_strain[k], log_force += more * about.by_skin.log_force[k];
      }
    }
    VectorXd changed = of_modulus(std::move(log_strain), log_force);
    if (by_pad) changed.array() -= m.face.pad_log;
    return changed;
  };
  const VectorXd used = found(w, likeliest, 0);
  VectorXd mean = VectorXd::Zero(used.size());
  each([&](const TissueWindow& about, const CandidateTissue& m) {
    mean += m.weight * (found(about, m) - used);
  });
  out.shift = in_cells(mean);
  // What tissues differ by.
  std::vector<VectorXd> differing;
  each([&](const TissueWindow& about, const CandidateTissue& m) {
    VectorXd away = in_cells(found(about, m) - used - mean);
    for (std::size_t k = 0; k < skins; ++k) away += (skin_of(m, k) - skin[k]) * skin_cells(cells, k);
    differing.push_back(std::sqrt(m.weight) * away);
  });
  const MatrixXd apart = columns_of(differing);
  out.between = apart.rowwise().norm();
  out.between_modes = principal(apart, kMostBetween);
  // And what each leaves open of itself; a block, whose length alone bears the force, that.
  std::vector<VectorXd> own;
  each([&](const TissueWindow& about, const CandidateTissue& m) {
    const double share = m.weight / weights;
    if (m.block && in.force)
      own.push_back(
          VectorXd::Constant(static_cast<Index>(cells.size()), std::sqrt(share) * about.elevation.deviation));
    std::vector<VectorXd> by;  // in the order of the fit's columns
    if (!m.block)
      by = {in_cells(of_modulus(m.by_elevation.strain, m.by_elevation.force)),
            in_cells(of_modulus(m.by_depth.strain, m.by_depth.force))};
    if (!m.block && all && m.by_beside.size())
      by.push_back(in_cells(of_modulus(m.by_beside, m.force_by_beside)));
    if (!m.block && pad)
      by.push_back(in_cells(of_modulus(about.by_pad_thickness.strain, about.by_pad_thickness.force)));
    const auto lengths = std::ssize(by), count = lengths + static_cast<Index>(skins);
    for (std::size_t k = 0; k < skins; ++k) {
      by.push_back(skin_cells(cells, k));
      if (m.with_skin)
        by.back() += in_cells(of_modulus(about.by_skin.log_strain[k], about.by_skin.log_force[k]));
    }
    MatrixXd covariance = MatrixXd::Zero(count, count);
    if (m.with_skin) {
      covariance = m.with_skin->covariance.block(kElevation, kElevation, count, count);
    } else {
      if (all && !m.block)
        covariance.topLeftCorner(lengths, lengths) =
            m.fit.covariance.block(kElevation, kElevation, lengths, lengths);
      else if (!m.block)
        for (Index k = 0; const KnownLength* known : {&about.elevation, &about.depth, &about.pad})
          if (k < lengths) covariance(k, k) = squared(known->deviation), ++k;
      for (Index k = 0; k < count - lengths; ++k)
        covariance(lengths + k, lengths + k) = squared(about.skin.deviation[static_cast<std::size_t>(k)]);
    }
    const MatrixXd root = covariance.llt().matrixL();
    for (Index k = 0; k < count; ++k) {
      VectorXd change = VectorXd::Zero(static_cast<Index>(cells.size()));
      for (Index l = k; l < count; ++l) change += root(l, k) * by[static_cast<std::size_t>(l)];
      own.push_back(std::sqrt(share) * change);
    }
  });
  if (by_pad) {  // what its own strain is off by, in the mean
    const double noise = std::sqrt(beside.dot(w.measured.deviation.cwiseAbs2()) / beside.sum());
    own.push_back(VectorXd::Constant(
        static_cast<Index>(cells.size()),
        std::hypot(likeliest.fit.rest, noise) / std::sqrt(std::max(1.0, w.places * beside.sum()))));
  }
  out.changes = principal(columns_of(own), kMostChanges);
  out.common_log = kCommonLog;
  const double grading = all ? likeliest.fit.at[kGrading] : 0;
  out.rest = std::abs(grading) < kMaxGrading ? likeliest.fit.rest
                                             : std::hypot(likeliest.fit.rest, kSpreadOfDepth * grading);
  out.as_usual = !all && !(w.elevation.stated && (w.depth.stated || in.tissue.doubted_depth_m > 0));
  out.untried = untried;
  out.unweighed = !out.untried.empty() && out.rest > kWellExplained;
  // Nor was it where the face is tilted so much.
  const bool tilted = std::abs(likeliest.fit.at[kTilt]) > kMaxTiltOfSides && out.rest > kWellExplained;
  if (tilted) out.untried_log = kUnweighedLog;
  const double untried_log = out.unweighed || tilted ? kUnweighedLog
                             : out.untried.empty()   ? 0
                                                     : kWellExplainedLog;
  out.common_log = std::hypot(out.common_log, untried_log);
  if (const double doubted_m = in.tissue.doubted_depth_m; doubted_m > 0)
    out.contradicted = fmt::format(
        "the tissue's depth is stated as {:.1f} mm, but tissue is strained below it", 1e3 * doubted_m);
  put_into_words(order, all, grading, in.tissue.surface_m + (pad ? 0 : top_of(in.measured)), out);
  if (!out.contradicted.empty()) out.common_log = std::hypot(out.common_log, kContradictedLog);
  return out;
}

}  // namespace teletact::service
