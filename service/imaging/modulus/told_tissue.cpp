#include "service/imaging/modulus/told_tissue.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>

#include "service/base/squared.h"
#include "service/imaging/modulus/skin.h"

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// What the model leaves out alike of all slices is not below what so many leave of it.
constexpr double kMostSlices = 4;
constexpr double kNotWeighed = -5;  // ln of the likelihood of a tissue that a slice did not weigh; the least
// From slice to slice, of ln of elevation and depth: standard deviations; of the skin kSkinVariesLog.
constexpr double kElevationVaries = 0.02, kDepthVaries = 0.03;
constexpr double kUnlike = 3;              // deviations
constexpr double kNearWhereSolved = 0.04;  // of ln of the lengths: the next slice need not begin elsewhere
constexpr double kLeastTold = 1e-6;        // of a variance, taken off: less is rounding

struct WeighedSlice {
  const ToldBeside& slice;
  double weight;
};

// A face sees the tissue around its image, too: slices nearer to each other than it is long count in part.
std::vector<WeighedSlice> weighed(const std::vector<ToldBeside>& beside, double elevation_m) {
  std::vector<WeighedSlice> out;
  double sum = 0;
  for (const ToldBeside& slice : beside) {
    double gap_m = std::abs(slice.offset_m);  // to the next on the way to this image
    for (const ToldBeside& other : beside)
      if (other.offset_m * slice.offset_m > 0 && std::abs(other.offset_m) < std::abs(slice.offset_m))
        gap_m = std::min(gap_m, std::abs(slice.offset_m - other.offset_m));
    out.push_back({slice, std::min(1.0, gap_m / elevation_m)});
    sum += out.back().weight;
  }
  if (sum > kMostSlices)
    for (WeighedSlice& w : out) w.weight *= kMostSlices / sum;
  return out;
}

// Of the faces and depths that the fits of two lead to, of solids: how far ln of either differs.
double apart(const CandidateTissue& a, const CandidateTissue& b) {
  const auto of = [&](double ProbeFace::*length, Index column) {
    return std::abs(std::log(a.face.*length / (b.face.*length)) + a.fit.at[column] - b.fit.at[column]);
  };
  return std::max(of(&ProbeFace::elevation_m, kElevation), of(&ProbeFace::depth_m, kDepth));
}

bool same(const ToldTissue& a, const ToldTissue& b) {
  return a.ends == b.ends && a.slides == b.slides && a.place == b.place;
}

const ToldTissue* find(const std::vector<ToldTissue>& tissues, const ToldTissue& name) {
  const auto at = std::ranges::find_if(tissues, [&](const ToldTissue& t) { return same(t, name); });
  return at == tissues.end() ? nullptr : &*at;
}

}  // namespace

ToldTissue named(const TissueWindow& w, const CandidateTissue& m) {
  const auto [ends, slides] = kind_of(m);
  const double place = m.face.goes_on() ? 0 : m.place_m / w.face.depth_m;
  const bool stated = place > 0 && m.place_m == w.beside_m;
  return {ends, slides, stated ? -1 : static_cast<int>(std::lround(100 * place))};
}

const ToldTissue* nearest(const std::vector<ToldBeside>& beside, const ToldTissue& name) {
  const auto at =
      std::ranges::min_element(beside, {}, [](const ToldBeside& s) { return std::abs(s.offset_m); });
  const ToldTissue* told = at == beside.end() ? nullptr : find(at->tissues, name);
  return told && told->elevation_m > 0 && told->depth_m > 0 ? told : nullptr;
}

double told_odds(const std::vector<ToldBeside>& beside, const ProbeFace& face, const ToldTissue& name) {
  // Where the face is tilted nothing that ends is tried, and nothing is told of where the tissue does.
  const auto weighed_ends = [](const WeighedSlice& w) {
    return std::ranges::any_of(w.slice.tissues,
                               [](const ToldTissue& t) { return t.ends == 1 || t.ends == 2; });
  };
  double odds = 0;
  for (const WeighedSlice& w : weighed(beside, face.elevation_m)) {
    if (!weighed_ends(w)) continue;
    const ToldTissue* told = find(w.slice.tissues, name);
    odds += w.weight * (told ? std::max(kNotWeighed, told->log_likelihood) : kNotWeighed);
  }
  return odds;
}

ProbeFace begun_at(const ToldTissue& told, const TissueWindow& w, ProbeFace face) {
  const auto within = [](const KnownLength& of, double at_m) {
    return std::clamp(at_m, std::exp(of.low), std::exp(of.high));
  };
  face.elevation_m = within(w.elevation, told.elevation_m);
  face.depth_m = within(w.depth, told.depth_m);
  return face;
}

namespace {

// What is told of a tissue: which columns of its fit, the face's before the skin's; what those are beyond;
// what is known of them beforehand, as the fit heeds it; how they vary from slice to slice.
struct Numbers {
  std::vector<Index> columns;
  VectorXd beyond, usual, known, varies;
};

constexpr std::size_t kLengths = 2;  // of them: the first, which are linear over kLinear

Numbers numbers_of(const TissueWindow& w, const CandidateTissue& m) {
  if (m.block || w.as_stated) return {};
  const RobustFit& fit = m.with_skin ? *m.with_skin : m.fit;
  const auto count = static_cast<Index>(kLengths + (m.with_skin ? kSkinChanges : 0));
  Numbers out{{}, VectorXd(count), VectorXd(count), VectorXd(count), VectorXd(count)};
  const auto add = [&](Index column, double beyond, double usual, double deviation, bool doubted,
                       double varies) {
    const auto n = std::ssize(out.columns);
    const double away = doubted ? (fit.at[column] + beyond - usual) / deviation : 0;
    out.columns.push_back(column);
    out.beyond[n] = beyond, out.usual[n] = usual, out.varies[n] = squared(varies);
    out.known[n] = 1 / squared(deviation) / (1 + squared(away) / 2);  // fit_robustly()
  };
  const auto length = [&](Index column, double at_m, const KnownLength& known, double varies) {
    add(column, std::log(at_m), known.log, known.deviation, known.stated, varies);
  };
  length(kElevation, m.face.elevation_m, w.elevation, kElevationVaries);
  length(kDepth, m.face.depth_m, w.depth, kDepthVaries);
  if (m.with_skin)
    for (std::size_t k = 0; k < kSkinChanges; ++k)
      add(fit.at.size() - static_cast<Index>(kSkinChanges - k), 0, w.skin.mean[k], w.skin.deviation[k], true,
          kSkinVariesLog);
  return out;
}

// Without what is known beforehand, which is alike in all slices.
void tell_numbers(const Numbers& of, const RobustFit& fit, ToldTissue& told) {
  if (of.columns.empty()) return;
  const MatrixXd all = fit.covariance(of.columns, of.columns).inverse();
  const Eigen::SelfAdjointEigenSolver<MatrixXd> own(all - MatrixXd(of.known.asDiagonal()));
  const VectorXd load = all * (fit.at(of.columns) + of.beyond) - of.known.cwiseProduct(of.usual);
  // Rounding apart, no combination of them has less than no information.
  const VectorXd sizes = own.eigenvalues().cwiseMax(0);
  const VectorXd some = (sizes.array() > 0).cast<double>();
  const MatrixXd& by = own.eigenvectors();
  told.information = by * sizes.asDiagonal() * by.transpose();
  told.load = by * some.asDiagonal() * by.transpose() * load;
}

// As other slices tell it, each varying from this one; no information: none does.
ToldTissue pooled(const std::vector<WeighedSlice>& slices, const ToldTissue& name, const VectorXd& varies) {
  const Index count = varies.size();
  ToldTissue out;
  for (const auto& [slice, weight] : slices) {
    const ToldTissue* told = find(slice.tissues, name);
    if (told == nullptr || told->load.size() != count || count == 0) continue;
    if (out.load.size() == 0)
      out.information = MatrixXd::Zero(count, count), out.load = VectorXd::Zero(count);
    const MatrixXd part =
        weight * (MatrixXd::Identity(count, count) + told->information * varies.asDiagonal()).inverse();
    out.information += part * told->information, out.load += part * told->load;
  }
  return out;
}

}  // namespace

std::vector<ToldTissue> told_by(const std::vector<WeighedTissues>& starts) {
  std::vector<ToldTissue> out;
  double best = -HUGE_VAL;
  for (const WeighedTissues& start : starts)
    for (const CandidateTissue& m : start.models) {
      ToldTissue told = named(start.window, m);
      told.log_likelihood = -m.fit.misfit;
      best = std::max(best, told.log_likelihood);
      tell_numbers(numbers_of(start.window, m), m.with_skin ? *m.with_skin : m.fit, told);
      const auto twin = std::ranges::find_if(out, [&](const ToldTissue& t) { return same(t, told); });
      if (twin == out.end())
        out.push_back(std::move(told));
      else if (told.log_likelihood > twin->log_likelihood)
        *twin = std::move(told);
    }
  for (ToldTissue& told : out) told.log_likelihood -= best;
  return out;
}

void add_odds(const std::vector<ToldBeside>& beside, std::vector<WeighedTissues>& starts) {
  for (WeighedTissues& start : starts)
    for (CandidateTissue& m : start.models)
      m.log_prior += told_odds(beside, start.window.face, named(start.window, m));
}

Heeded sharpen(const std::vector<ToldBeside>& beside, std::vector<WeighedTissues>& starts) {
  Heeded out = Heeded::kNothing;
  double heaviest = 0;
  for (WeighedTissues& start : starts) {
    const std::vector<WeighedSlice> slices = weighed(beside, start.window.face.elevation_m);
    for (CandidateTissue& m : start.models) {
      const Numbers of = numbers_of(start.window, m);
      const ToldTissue told = pooled(slices, named(start.window, m), of.varies);
      Heeded here = Heeded::kNothing;
      if (told.load.size() > 0) {
        // As one more measurement of those columns together.
        RobustFit& fit = m.with_skin ? *m.with_skin : m.fit;
        const MatrixXd across = fit.covariance(Eigen::all, of.columns),
                       own = fit.covariance(of.columns, of.columns);
        const Index count = own.rows();
        const MatrixXd gain = across * (MatrixXd::Identity(count, count) + told.information * own).inverse();
        const VectorXd moved = gain * (told.load - told.information * (fit.at(of.columns) + of.beyond));
        const MatrixXd less = gain * told.information * across.transpose();
        here = Heeded::kAll;
        for (std::size_t n = 0; n < of.columns.size(); ++n) {
          const Index c = of.columns[n];
          if (!(less(c, c) > kLeastTold * fit.covariance(c, c))) continue;
          if (std::abs(moved[c]) > kUnlike * std::sqrt(less(c, c)) ||
              (n < kLengths && std::abs(moved[c]) > kLinear))
            here = Heeded::kContradicted;
        }
        if (here == Heeded::kAll) fit.at += moved, fit.covariance -= (less + less.transpose()) / 2;
      }
      if (m.weight > heaviest) heaviest = m.weight, out = here;
    }
  }
  return out;
}

void weigh_together(std::vector<WeighedTissues>& starts) {
  using Models = std::vector<CandidateTissue*>;  // of one kind and start, the likeliest first
  std::vector<Models> counted;
  for (WeighedTissues& start : starts) {
    std::map<std::array<int, 2>, Models> kinds;
    for (CandidateTissue& m : start.models) kinds[kind_of(m)].push_back(&m);
    for (auto& [kind, models] : kinds) {
      std::ranges::sort(models, std::ranges::greater{}, &CandidateTissue::odds);
      const auto twin = std::ranges::find_if(counted, [&](const Models& others) {
        return kind_of(*others[0]) == kind &&
               (models[0]->block || apart(*others[0], *models[0]) < kOtherLength);
      });
      if (twin == counted.end())
        counted.push_back(models);
      else if (models[0]->odds() > (*twin)[0]->odds())
        *twin = models;
    }
  }
  double best = -HUGE_VAL, sum = 0;
  for (const Models& models : counted) best = std::max(best, models[0]->odds());
  for (const Models& models : counted)
    for (CandidateTissue* m : models) sum += m->weight = std::exp(m->odds() - best);
  for (const Models& models : counted)
    for (CandidateTissue* m : models) m->weight /= sum;
}

namespace {

// Where each tissue leads by all that is known, or where it was solved if that is near. The reference stays:
// places beside the probe are told by its depth.
void tell_begins(const std::vector<WeighedTissues>& starts, std::vector<ToldTissue>& told) {
  for (const WeighedTissues& start : starts)
    for (const CandidateTissue& m : start.models) {
      const auto at =
          std::ranges::find_if(told, [&](const ToldTissue& t) { return same(t, named(start.window, m)); });
      if (m.block || at == told.end() || (at->elevation_m > 0 && m.weight == 0)) continue;  // a twin
      ProbeFace face = m.face;
      if (m.weight > kLeastWeight) face = led_to(start.window, m, m.with_skin ? *m.with_skin : m.fit);
      if (way_to(face, m) < kNearWhereSolved) face = m.face;
      if (face.goes_on() && !face.slides) face = start.window.face;
      at->elevation_m = face.elevation_m, at->depth_m = face.depth_m;
      at->beside_m = face.goes_on() ? 0 : face.beside_m;
    }
}

}  // namespace

TogetherWeighed weigh_together(const TissueWeigher& weigher, const std::vector<ToldBeside>& beside,
                               std::vector<WeighedTissues>& starts) {
  const auto weigh = [&](std::vector<WeighedTissues>& of) {
    weigh_together(of);
    for (WeighedTissues& start : of)
      for (CandidateTissue& m : start.models)
        if (m.weight > kLeastWeight && !m.with_skin)
          weigher.fit_skin(start.window, m, std::hypot(m.fit.rest, kModelLog));
  };
  weigh(starts);
  TogetherWeighed out{told_by(starts)};
  if (!beside.empty()) {
    std::vector<WeighedTissues> together = starts;
    add_odds(beside, together);
    weigh(together);
    out.heeded = sharpen(beside, together);
    if (out.heeded != Heeded::kContradicted) starts = std::move(together);
  }
  tell_begins(starts, out.told);
  return out;
}

}  // namespace teletact::service
