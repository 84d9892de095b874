#include "bench/fuzz/laws.h"

#include <algorithm>
#include <vector>

namespace teletact::bench {
namespace {

constexpr std::size_t kColumnsInPiece = 8;

}  // namespace

FuzzLaws::FuzzLaws(Source& source, double hostile) : source_(source), hostile_(hostile) {
  book_.open(0);
}

void FuzzLaws::tell(const StabilityTissue& tissue, std::uint64_t version) {
  told_version_ = version;
  client::NearLaw law = tissue.law(version);
  const double wrong = source_.happens(hostile_) ? std::log(source_.logarithmic(0.01, 100)) : 0;
  for (const double z_m : across_ ? std::vector<double>{-0.01, 0.01} : std::vector<double>{0})
    for (std::size_t first = 0; first < law.count; first += kColumnsInPiece) {
      const std::size_t end = std::min(first + kColumnsInPiece + 1, law.count);  // pieces share a column
      v1::LawPiece& piece = waiting_.emplace_back();
      piece.set_model_version(version);
      piece.set_z_m(z_m);
      piece.set_lane_before_m(std::min(z_m, 0.0) - (z_m > 0) * 0.01);
      piece.set_guess(across_ && source_.one_of(2) == 0);
      piece.set_begin_x_m(law.columns[first].x_m);
      piece.set_end_x_m(law.columns[end - 1].x_m);
      piece.set_force_error_share(law.columns[first].error_share);
      piece.set_force_error_n(law.columns[first].error_n);
      for (std::size_t i = first; i < end; ++i) {
        v1::LawColumn* column = piece.add_columns();
        column->set_x_m(law.columns[i].x_m);
        column->set_of_force_error(static_cast<float>(source_.between(0, 1)));
        for (std::size_t row = 0; row < law.columns[i].rows; ++row) {
          const LawSample& sample = law.columns[i].samples[row];
          column->add_log_indentation(law.columns[i].log_depth[row]);
          for (const double value : {sample.log_energy + wrong, double(sample.by_x_1_m),
                                     double(sample.by_log_depth), double(sample.mixed_1_m)})
            column->add_samples(float(value));
          for (int k = 0; across_ && k < 4; ++k) column->add_samples(float(source_.between(-1, 1)));
        }
      }
    }
}

// One thing wrong with it.
void FuzzLaws::spoil(v1::LawPiece& piece) {
  const int at = static_cast<int>(source_.one_of(static_cast<std::uint64_t>(piece.columns_size())));
  v1::LawColumn& column = *piece.mutable_columns(at);
  const auto some = [this](google::protobuf::RepeatedField<float>* values) {
    for (float& value : *values)
      if (source_.one_of(3) == 0) value = static_cast<float>(source_.wild());
  };
  switch (source_.one_of(12)) {
    case 0:
      return some(column.mutable_samples());
    case 1:
      return some(column.mutable_log_indentation());
    case 2:  // plausible, and no tissue
      for (float& value : *column.mutable_samples()) value *= static_cast<float>(source_.between(0, 4));
      return;
    case 3:
      return column.add_samples(static_cast<float>(source_.wild()));
    case 4:
      return column.set_x_m(source_.wild());
    case 5:
      return source_.one_of(2) == 0 ? piece.set_begin_x_m(source_.wild()) : piece.set_end_x_m(source_.wild());
    case 6:
      return source_.one_of(2) == 0 ? piece.set_force_error_n(static_cast<float>(source_.wild()))
                                    : piece.set_force_error_share(static_cast<float>(source_.wild()));
    case 7:
      return piece.set_model_version(source_.one_of(20));
    case 8:
      return column.set_of_force_error(static_cast<float>(source_.wild()));
    case 9:
      return source_.one_of(2) == 0 ? piece.set_z_m(source_.wild()) : piece.set_lane_before_m(source_.wild());
    case 10:
      return piece.set_guess(!piece.guess());
    default:
      return piece.clear_columns();
  }
}

std::optional<client::NearLaw> FuzzLaws::next(const StabilityTissue& tissue, std::uint64_t version,
                                              double finger_x_m, FuzzShares& shares) {
  // Told again now and then, and not always the same.
  if (version != told_version_ || (waiting_.empty() && source_.happens(0.1))) tell(tissue, version);
  if (source_.happens(1e-3)) {  // another stream
    book_.open(0);
    piece_ = 0;
    waiting_.clear();
    told_version_ = 0;
    across_ = source_.one_of(2) == 0;
  }
  if (!waiting_.empty() && source_.happens(0.3)) {
    v1::LawPiece piece = waiting_.front();
    waiting_.pop_front();
    if (source_.happens(hostile_)) {
      spoil(piece);
      ++shares.hostile_laws;
    }
    ++shares.pieces;
    piece.set_piece(++piece_);
    book_.take(piece, finger_x_m);
  }
  return book_.fresh(finger_x_m);
}

}  // namespace teletact::bench
