// Plain normalised cross-correlation (T2.1) over the whole search range, no guess and no help from
// neighbours; the sub-sample peak by parabolas, as is usual (biased, T2.2). The sums of products of one lag
// are shared by all windows that overlap: a window is a whole number of grid steps long (Luo & Konofagou
// 2010, doi 10.1109/TUFFC.2010.1554, by blocks instead of running sums).
#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "bench/peers/rf_nodes.h"

namespace teletact::bench {
namespace {

using reference::RfImage;

// Blocks of one grid step, kBefore of them before the first node's window ends and behind the last.
class BlockSums {
 public:
  BlockSums(const RfImage& pre, const RfImage& post, const Nodes& nodes, int blocks, int reach)
      : nodes_(nodes),
        blocks_(blocks),
        pad_(reach + (blocks + 1) * nodes.grid.sample_step),
        lines_(pre.lines) {
    pre_ = padded(pre);
    post_ = padded(post);
    rows_ = nodes.grid.ny + blocks;
  }

  // Sum over the window of every node of a * b, b moved by the lags; a, b: pre or post.
  void products(bool a_is_post, bool b_is_post, int axial, int lateral, int half_lines,
                std::vector<double>& out) {
    const Eigen::MatrixXd &a = a_is_post ? post_ : pre_, &b = b_is_post ? post_ : pre_;
    const int a_axial = a_is_post ? axial : 0, a_lateral = a_is_post ? lateral : 0;
    per_block_.setZero(rows_, lines_);
    const int step = nodes_.grid.sample_step, first = pad_ + nodes_.grid.first_sample - blocks_ / 2 * step;
    for (int l = 0; l < lines_; ++l) {
      const int la = l + a_lateral, lb = l + lateral;
      if (la < 0 || la >= lines_ || lb < 0 || lb >= lines_) continue;
      for (int r = 0; r < rows_; ++r) {
        const int k = first + r * step;
        if (k < 0 || k + step > a.rows() || k + axial < 0 || k + axial + step > b.rows()) continue;
        per_block_(r, l) = a.col(la).segment(k + a_axial, step).dot(b.col(lb).segment(k + axial, step));
      }
    }
    gather(half_lines, out);
  }

 private:
  Eigen::MatrixXd padded(const RfImage& image) const {
    Eigen::MatrixXd out = Eigen::MatrixXd::Zero(image.samples + 2 * pad_, image.lines);
    for (int l = 0; l < image.lines; ++l)
      for (int k = 0; k < image.samples; ++k) out(pad_ + k, l) = image.at(k, l);
    return out;
  }

  void gather(int half_lines, std::vector<double>& out) {
    Eigen::VectorXd column(rows_);
    for (int i = 0; i < nodes_.grid.nx; ++i) {
      const int from = std::max(0, nodes_.line(i) - half_lines),
                to = std::min(lines_ - 1, nodes_.line(i) + half_lines);
      column = per_block_.middleCols(from, to - from + 1).rowwise().sum();
      for (int j = 0; j < nodes_.grid.ny; ++j) out[nodes_.at(i, j)] = column.segment(j, blocks_).sum();
    }
  }

  const Nodes& nodes_;
  int blocks_, pad_, lines_, rows_ = 0;
  Eigen::MatrixXd pre_, post_, per_block_;  // per_block_(block, line)
};

void search(const TrackerOptions& options, const RfImage& pre, const RfImage& post, const Nodes& nodes,
            int reach, int lateral_reach, LagField& field) {
  const int blocks =
      2 * std::max(1, static_cast<int>(std::lround(options.window_axial_m / 2 /
                                                   (nodes.grid.sample_step * nodes.sample_m))));
  const int half_lines = nodes.window(1, options.window_lateral_m).half_lateral;
  BlockSums sums(pre, post, nodes, blocks, reach);
  std::vector<double> aa(field.axial.size()), bb(aa), ab(aa);
  sums.products(false, false, 0, 0, half_lines, aa);
  for (int lateral = -lateral_reach; lateral <= lateral_reach; ++lateral)
    for (int axial = -reach; axial <= reach; ++axial) {
      sums.products(false, true, axial, lateral, half_lines, ab);
      sums.products(true, true, axial, lateral, half_lines, bb);
      for (std::size_t n = 0; n < ab.size(); ++n) {
        const double c = ab[n] / std::sqrt(std::max(aa[n] * bb[n], 1e-30));
        if (!(c > field.correlation[n])) continue;
        field.correlation[n] = c;
        field.axial[n] = axial;
        field.lateral[n] = lateral;
      }
    }
}

Track by_cross_correlation(const TrackerOptions& options, const service::RfFrame& pre_frame,
                           const service::RfFrame& post_frame, const service::AcquisitionGeometry& geometry) {
  const Nodes nodes(pre_frame, geometry, options.grid_dx_m, options.grid_dy_m);
  const RfImage pre = image_of(pre_frame), post = image_of(post_frame);
  const double deepest_m = geometry.first_sample_depth_m + pre.samples * nodes.sample_m;
  const int reach = static_cast<int>(std::ceil(options.max_strain * deepest_m / nodes.sample_m)) + 4;
  const int lateral_reach = static_cast<int>(std::ceil(options.lateral_search_m / nodes.line_m));
  LagField field(nodes.image.size());
  search(options, pre, post, nodes, reach, lateral_reach, field);
  // The parabolas, through the peak found.
  match_nodes(pre, post, nodes, nodes.window(options.window_axial_m, options.window_lateral_m), 0, 0, field);
  return track_of(nodes, field, options.min_correlation);
}

}  // namespace

Tracker make_ncc_tracker(TrackerOptions options) {
  return {"plain NCC", std::bind_front(by_cross_correlation, options)};
}

}  // namespace teletact::bench
