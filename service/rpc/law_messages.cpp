#include "service/rpc/law_messages.h"

#include <algorithm>

namespace teletact::service {

void law_to(const LawPiece& piece, v1::LawPiece* out) {
  out->Clear();
  out->set_piece(piece.number);
  out->set_window_id(piece.window_id);
  out->set_model_version(piece.version);
  out->set_begin_x_m(piece.begin_m);
  out->set_end_x_m(piece.end_m);
  // The two have one ratio in all columns.
  const LawColumn& worst =
      *std::max_element(piece.columns.begin(), piece.columns.end(),
                        [](const auto& one, const auto& other) { return one.error_n < other.error_n; });
  out->set_force_error_share(worst.error_share);
  out->set_force_error_n(worst.error_n);
  for (const LawColumn& column : piece.columns) {
    v1::LawColumn* to = out->add_columns();
    to->set_x_m(column.x_m);
    to->set_of_force_error(worst.error_n > 0 ? column.error_n / worst.error_n : 0);
    for (std::size_t i = 0; i < column.rows; ++i) {
      to->add_log_indentation(column.log_depth[i]);
      const LawSample& sample = column.samples[i];
      for (const float value : {sample.log_energy, sample.by_x_1_m, sample.by_log_depth, sample.mixed_1_m})
        to->add_samples(value);
    }
  }
}

}  // namespace teletact::service
