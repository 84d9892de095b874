#include "client/link/law_book.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <vector>

namespace teletact::client {
namespace {

constexpr double kFarthestM = 10;  // of what is believed
constexpr double kStaysM = 0.005;  // a finger that has come further gets another part of the law
constexpr int kMostInPiece = 64;

// None where it is malformed.
std::optional<std::vector<LawColumn>> columns_from(const v1::LawPiece& piece) {
  if (piece.columns_size() < 1 || piece.columns_size() > kMostInPiece) return std::nullopt;
  std::vector<LawColumn> columns;
  for (const v1::LawColumn& in : piece.columns()) {
    const int rows = in.log_indentation_size();
    if (rows < 1 || rows > int(LawColumn::kMostRows) || in.samples_size() != 4 * rows) return std::nullopt;
    LawColumn& column = columns.emplace_back();
    column.x_m = in.x_m();
    column.version = piece.model_version();
    const float share = in.of_force_error() == 0 ? 1 : in.of_force_error();
    column.error_share = share * piece.force_error_share();
    column.error_n = share * piece.force_error_n();
    column.rows = static_cast<std::uint8_t>(rows);
    for (int i = 0; i < rows; ++i) {
      const auto row = static_cast<std::size_t>(i);
      column.log_depth[row] = in.log_indentation(i);
      column.samples[row] = {in.samples(4 * i), in.samples(4 * i + 1), in.samples(4 * i + 2),
                             in.samples(4 * i + 3)};
    }
    const bool ordered = columns.size() < 2 || columns[columns.size() - 2].x_m < column.x_m;
    if (!usable(column) || !ordered || !(std::abs(column.x_m) <= kFarthestM)) return std::nullopt;
  }
  return columns;
}

}  // namespace

void LawBook::open(double layer_depth_m) {
  *this = LawBook();
  layer_depth_m_ = layer_depth_m;
  changed_ = true;
}

bool LawBook::take(const v1::LawPiece& piece, double finger_x_m) {
  if (piece.piece() != pieces_ + 1) return false;
  ++pieces_;  // whatever it holds, it has come
  auto columns = columns_from(piece);
  const double begin_m = piece.begin_x_m(), end_m = piece.end_x_m();
  if (!columns || !(begin_m <= columns->front().x_m && end_m >= columns->back().x_m)) return false;
  // The span's first column may stand amid an older law: that cell was whole, and still is.
  const auto split = columns_.lower_bound(begin_m);
  const bool joined_before = split != columns_.end() && split != columns_.begin() && split->second.joined;
  std::erase_if(columns_, [&](const auto& known) {
    return known.first >= begin_m && known.first <= end_m && known.second.version < piece.model_version();
  });
  for (const LawColumn& column : *columns) {
    const auto right = columns_.lower_bound(column.x_m);
    const bool known = right != columns_.end() && right->first == column.x_m;
    // Not amid, nor in place of, what is newer.
    const bool amid = right != columns_.end() && right != columns_.begin() && right->second.joined &&
                      std::min(right->second.version, std::prev(right)->second.version) > column.version;
    if (known ? right->second.version <= column.version : !amid) columns_[column.x_m] = column;
  }
  for (auto at = columns_.lower_bound(begin_m); at != columns_.end() && at->first <= end_m; ++at)
    at->second.joined = at->first > begin_m || joined_before;
  forget_far_from(finger_x_m);
  return changed_ = true;
}

void LawBook::forget_far_from(double x_m) {
  while (columns_.size() > kMostColumns) {
    const bool first = std::abs(columns_.begin()->first - x_m) > std::abs(columns_.rbegin()->first - x_m);
    columns_.erase(first ? columns_.begin() : std::prev(columns_.end()));
  }
}

std::optional<NearLaw> LawBook::fresh(double x_m) {
  if (!changed_ && std::abs(x_m - given_x_m_) < kStaysM) return std::nullopt;
  changed_ = false;
  given_x_m_ = x_m;
  NearLaw law;
  law.layer_depth_m = layer_depth_m_;
  // As many to the left as to the right of x.
  auto begin = columns_.lower_bound(x_m), end = begin;
  while (law.count < NearLaw::kMost && (begin != columns_.begin() || end != columns_.end())) {
    if (begin != columns_.begin()) --begin, ++law.count;
    if (end != columns_.end() && law.count < NearLaw::kMost) ++end, ++law.count;
  }
  std::transform(begin, end, law.columns.begin(), [](const auto& known) { return known.second; });
  return law;
}

}  // namespace teletact::client
