#include "client/link/law_book.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <vector>

namespace teletact::client {
namespace {

constexpr double kFarthestM = 10;  // of what is believed
constexpr double kStaysM = 0.005;  // a finger that has come further gets another part of the law
constexpr int kMaxInPiece = 64;

// None where it is malformed.
std::optional<std::vector<LawColumn>> columns_from(const v1::LawPiece& piece) {
  if (piece.columns_size() < 1 || piece.columns_size() > kMaxInPiece) return std::nullopt;
  std::vector<LawColumn> columns;
  for (const v1::LawColumn& in : piece.columns()) {
    const int rows = in.log_indentation_size();
    if (rows < 1 || rows > int(LawColumn::kMaxRows)) return std::nullopt;
    const bool area = in.samples_size() == int(LawSample::kOfAnArea) * rows;
    if (!area && in.samples_size() != int(LawSample::kOfAPlane) * rows) return std::nullopt;
    LawColumn& column = columns.emplace_back();
    column.x_m = in.x_m();
    column.z_m = piece.z_m();
    column.lane_before_m = piece.lane_before_m();
    column.version = piece.model_version();
    column.of_area = area;
    column.corrected = !piece.guess();
    const float share = in.of_force_error() == 0 ? 1 : in.of_force_error();
    column.error_share = share * piece.force_error_share();
    column.error_n = share * piece.force_error_n();
    column.rows = static_cast<std::uint8_t>(rows);
    const float* next = in.samples().data();
    for (int i = 0; i < rows; ++i) {
      const auto row = static_cast<std::size_t>(i);
      column.log_depth[row] = in.log_indentation(i);
      LawSample& sample = column.samples[row];
      for (float* to : {&sample.log_energy, &sample.by_x_1_m, &sample.by_log_depth, &sample.mixed_1_m})
        *to = *next++;
      if (area)
        for (float* to : {&sample.by_z_1_m, &sample.by_zs_1_m, &sample.by_xz_1_m2, &sample.by_xzs_1_m2})
          *to = *next++;
    }
    const bool ordered = columns.size() < 2 || columns[columns.size() - 2].x_m < column.x_m;
    if (!usable(column) || !ordered || !(std::abs(column.x_m) <= kFarthestM) ||
        !(std::abs(column.z_m) <= kFarthestM))
      return std::nullopt;
  }
  return columns;
}

// As many of a sorted range as fit, on both sides of where it is split.
template <class Iterator>
std::pair<Iterator, Iterator> around(Iterator first, Iterator split, Iterator last, std::size_t most) {
  Iterator begin = split, end = split;
  for (std::size_t count = 0; count < most && (begin != first || end != last);) {
    if (begin != first) --begin, ++count;
    if (end != last && count < most) ++end, ++count;
  }
  return {begin, end};
}

}  // namespace

void LawBook::open(double layer_depth_m) {
  *this = LawBook();
  layer_depth_m_ = layer_depth_m;
  changed_ = true;
}

void LawBook::go_on_from(const LawBook& before) {
  if (before.layer_depth_m_ != layer_depth_m_) return;
  const auto pieces = pieces_;
  *this = before;
  pieces_ = pieces;
  changed_ = true;
}

bool LawBook::take(const v1::LawPiece& piece, double finger_x_m, double finger_z_m) {
  if (piece.piece() != pieces_ + 1) return false;
  ++pieces_;  // whatever it holds, it has come
  auto columns = columns_from(piece);
  const double begin_m = piece.begin_x_m(), end_m = piece.end_x_m();
  if (!columns || !(begin_m <= columns->front().x_m && end_m >= columns->back().x_m)) return false;
  Lane& lane = lanes_[piece.z_m()];
  columns_ -= lane.size();
  // The span's first column may stand amid an older law: that cell was whole, and still is.
  const auto split = lane.lower_bound(begin_m);
  const bool joined_before = split != lane.end() && split != lane.begin() && split->second.joined;
  std::erase_if(lane, [&](const auto& known) {
    return known.first >= begin_m && known.first <= end_m && known.second.version < piece.model_version();
  });
  for (const LawColumn& column : *columns) {
    const auto right = lane.lower_bound(column.x_m);
    const bool known = right != lane.end() && right->first == column.x_m;
    // Not amid, nor in place of, what is newer.
    const bool amid = right != lane.end() && right != lane.begin() && right->second.joined &&
                      std::min(right->second.version, std::prev(right)->second.version) > column.version;
    if (known ? right->second.version <= column.version : !amid) lane[column.x_m] = column;
  }
  for (auto at = lane.lower_bound(begin_m); at != lane.end() && at->first <= end_m; ++at)
    at->second.joined = at->first > begin_m || joined_before;
  columns_ += lane.size();
  if (lane.empty()) lanes_.erase(piece.z_m());
  forget_far_from(finger_x_m, finger_z_m);
  return changed_ = true;
}

// Of the lane that is farthest its farthest end; of the only one, the same.
void LawBook::forget_far_from(double x_m, double z_m) {
  const auto farther_first = [](const auto& all, double at) {
    return std::abs(all.begin()->first - at) > std::abs(all.rbegin()->first - at);
  };
  while (columns_ > kMaxColumns) {
    const auto far = farther_first(lanes_, z_m) ? lanes_.begin() : std::prev(lanes_.end());
    Lane& lane = far->second;
    lane.erase(farther_first(lane, x_m) ? lane.begin() : std::prev(lane.end()));
    --columns_;
    if (lane.empty()) lanes_.erase(far);
  }
}

std::optional<NearLaw> LawBook::fresh(double x_m, double z_m, bool guesses) {
  const bool stays = std::abs(x_m - given_x_m_) < kStaysM &&
                     (lanes_.size() < 2 || std::abs(z_m - given_z_m_) < kStaysM) && guesses == given_guesses_;
  if (!changed_ && stays) return std::nullopt;
  changed_ = false;
  given_x_m_ = x_m, given_z_m_ = z_m, given_guesses_ = guesses;
  NearLaw law;
  law.layer_depth_m = layer_depth_m_;
  // As many to one side as to the other, along both.
  const auto [first, last] =
      around(lanes_.begin(), lanes_.lower_bound(z_m), lanes_.end(), NearLaw::kMaxLanes);
  const auto lanes = static_cast<std::size_t>(std::distance(first, last));
  for (auto lane = first; lane != last; ++lane) {
    const auto& columns = lane->second;
    const auto [begin, end] =
        around(columns.begin(), columns.lower_bound(x_m), columns.end(), NearLaw::kMax / lanes);
    bool missing = false;
    for (auto at = begin; at != end; ++at) {
      missing = missing || !at->second.joined;
      const bool given = guesses || at->second.corrected;
      if (given) {
        law.columns[law.count] = at->second;
        law.columns[law.count++].joined = !missing;
      }
      missing = !given;
    }
  }
  return law;
}

}  // namespace teletact::client
