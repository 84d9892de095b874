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
  const LawColumn& lane = piece.columns.front();
  out->set_z_m(lane.z_m);
  out->set_lane_before_m(lane.lane_before_m);
  out->set_guess(!lane.corrected);
  float share = 0, error_n = 0;
  for (const LawColumn& column : piece.columns) {
    share = std::max(share, column.error_share);
    error_n = std::max(error_n, column.error_n);
  }
  out->set_force_error_share(share);
  out->set_force_error_n(error_n);
  const auto of = [](float part, float whole) { return whole > 0 ? part / whole : 0; };
  for (const LawColumn& column : piece.columns) {
    v1::LawColumn* to = out->add_columns();
    to->set_x_m(column.x_m);
    // One share of both: never less than the column states of either.
    to->set_of_force_error(std::max(of(column.error_share, share), of(column.error_n, error_n)));
    for (std::size_t i = 0; i < column.rows; ++i) {
      to->add_log_indentation(column.log_depth[i]);
      const LawSample& s = column.samples[i];
      for (const float value : {s.log_energy, s.by_x_1_m, s.by_log_depth, s.mixed_1_m})
        to->add_samples(value);
      if (piece.lanes)
        for (const float value : {s.by_z_1_m, s.by_zs_1_m, s.by_xz_1_m2, s.by_xzs_1_m2})
          to->add_samples(value);
    }
  }
}

}  // namespace teletact::service
