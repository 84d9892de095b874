// What is said of forces that were felt beside the true ones: figures, lines for people, a picture.
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "client/files/metaimage.h"
#include "client/patient/tissue.h"
#include "client/report/session_record.h"
#include "service/contact/touch_model.h"

namespace teletact::bench {

// Deep enough to be owed a force, whatever was felt.
bool pressed(const client::TouchTick& tick);

// A pose that was felt.
struct FeltPose {
  double time_s = 0, way_m = 0;  // since the first
  service::Vector3 at{};
  Eigen::Vector3d felt_n, true_n, plane_n;
  std::optional<double> by_20_nodes_n;  // the true normal force by elements of 20 nodes, where it was solved
  double truths_nodes = 1;  // of layered tissue: force on the truth's nodes over that on ever finer ones
  // What the newest answer states that the force may be off by, over it; none: it stated nothing.
  std::optional<double> half_width;
  bool held() const { return half_width && (felt_n - true_n).norm() <= *half_width * felt_n.norm(); }
};

// A lump from above.
struct Shadow {
  double x_m, z_m, radius_m;
};

// `summary` with the error of the forces, and each pose.
nlohmann::json judge(nlohmann::json summary, const std::vector<FeltPose>& felt, double coverage);
// What a plane model would have answered. After judge().
void judge_plane(nlohmann::json& summary, const std::vector<FeltPose>& felt);
// How much of the path the stated intervals hold, and how wide they are.
void judge_intervals(nlohmann::json& summary, const std::vector<FeltPose>& felt);
// The truth's normal force, and the felt one, beside that by elements of 20 nodes. After judge().
void judge_by_20_nodes(nlohmann::json& summary, const std::vector<FeltPose>& felt);
// What had been imaged where the finger was when it was there.
void judge_slices(nlohmann::json& summary, const client::AcquireRecord& acquire,
                  const std::vector<client::TouchTick>& path);
// The topmost 3 mm of a volume as one number, over the truth's, and the mean of its stated deviations of ln
// E: what the number is off by if all of them err alike. Throws BenchError where the two volumes are unlike.
void judge_top(nlohmann::json& summary, const client::MetaImage& volume, const client::MetaImage& log_std,
               const client::Tissue& tissue);
// The lumps of a volume beside the patient's.
void judge_lumps(nlohmann::json& summary, const client::MetaImage& volume, const client::Tissue& tissue);

// Of a summary that has been judged; the first of one with intervals, slices and lumps.
std::string readable_from_rf(const nlohmann::json& summary);
std::string readable(const nlohmann::json& summary);

void draw(const std::vector<FeltPose>& felt, const std::vector<Shadow>& shadows, bool with_plane,
          const std::filesystem::path& file);

}  // namespace teletact::bench
