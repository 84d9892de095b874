// Tissue files: TOML in, TOML out.
#include <toml++/toml.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <fstream>
#include <initializer_list>
#include <limits>
#include <sstream>
#include <string_view>

#include "client/files/file_io.h"
#include "client/patient/tissue.h"

namespace teletact::client {

namespace {

// One table of the file; reads known keys, refuses the others.
class Section {
 public:
  Section(const toml::table& table, std::string prefix) : table_(table), prefix_(std::move(prefix)) {}

  void only(std::initializer_list<std::string_view> known) const {
    for (const auto& [key, value] : table_)
      if (std::find(known.begin(), known.end(), key.str()) == known.end()) {
        std::string list;
        for (const std::string_view k : known) list += (list.empty() ? "" : ", ") + std::string(k);
        throw TissueError(prefix_ + std::string(key.str()) + ": unknown key; known here: " + list);
      }
  }
  bool has(std::string_view key) const { return table_.contains(key); }
  void read(std::string_view key, double& out) const {
    if (!has(key)) return;
    const auto value = table_[key].value<double>();
    if (!value || !std::isfinite(*value))
      throw TissueError(prefix_ + std::string(key) + ": must be a number");
    out = *value;
  }
  // Like read(), but for a coefficient that may be without bound.
  void read_boundless(std::string_view key, double& out) const {
    if (has(key) && table_[key].value<double>() == std::numeric_limits<double>::infinity())
      out = std::numeric_limits<double>::infinity();
    else
      read(key, out);
  }
  // Which of `words` is given; `otherwise` where none is.
  std::size_t word(std::string_view key, std::initializer_list<std::string_view> words,
                   std::size_t otherwise) const {
    if (!has(key)) return otherwise;
    const auto value = table_[key].value<std::string>();
    const auto found = value ? std::find(words.begin(), words.end(), *value) : words.end();
    if (found != words.end()) return static_cast<std::size_t>(found - words.begin());
    std::string list;
    for (const std::string_view w : words) list += (list.empty() ? "" : ", ") + std::string(w);
    throw TissueError(prefix_ + std::string(key) + ": must be one of " + list);
  }
  template <class Unsigned>
  void read_count(std::string_view key, Unsigned& out) const {
    if (!has(key)) return;
    const auto value = table_[key].value_exact<std::int64_t>();
    if (!value || *value < 0) throw TissueError(prefix_ + std::string(key) + ": must be a whole number >= 0");
    out = static_cast<Unsigned>(*value);
  }
  Section table(std::string_view key) const {
    static const toml::table empty;
    if (!has(key)) return {empty, prefix_ + std::string(key) + "."};
    const toml::table* found = table_[key].as_table();
    if (found == nullptr)
      throw TissueError(prefix_ + std::string(key) + ": must be a table [" + std::string(key) + "]");
    return {*found, prefix_ + std::string(key) + "."};
  }
  const toml::array* array(std::string_view key) const {
    if (!has(key)) return nullptr;
    const toml::array* found = table_[key].as_array();
    if (found == nullptr) throw TissueError(prefix_ + std::string(key) + ": must be a list");
    return found;
  }
  const std::string& prefix() const { return prefix_; }

 private:
  const toml::table& table_;
  std::string prefix_;
};

Inclusion read_inclusion(const toml::node& node, std::size_t index) {
  const std::string name = "inclusion[" + std::to_string(index) + "]";
  if (!node.is_table()) throw TissueError(name + ": must be a table [[inclusion]]");
  const Section s(*node.as_table(), name + ".");
  s.only({"position_m", "diameter_m", "contrast", "shape"});
  for (const char* key : {"position_m", "diameter_m", "contrast"})
    if (!s.has(key)) throw TissueError(s.prefix() + key + ": is missing; add it");
  const toml::array& position = *s.array("position_m");
  Inclusion inclusion;
  const bool deep = position.size() == 3;
  const std::array<double*, 3> to{&inclusion.x_m, &inclusion.y_m, &inclusion.z_m};
  for (std::size_t k = 0; k < (deep ? 3 : 2); ++k) {
    const auto number = deep || position.size() == 2 ? position[k].value<double>() : std::nullopt;
    if (!number) throw TissueError(s.prefix() + "position_m: must be two numbers [x, y], or three [x, y, z]");
    *to[k] = *number;
  }
  inclusion.sphere = s.word("shape", {"cylinder", "sphere"}, 0) == 1;
  s.read("diameter_m", inclusion.diameter_m);
  s.read("contrast", inclusion.contrast);
  return inclusion;
}

void read_probe(const Section& s, double depth_m, Probe& probe) {
  s.only({"width_m", "lines", "elevation_m", "compression_m", "compression_strain", "force_noise_relative",
          "force_noise_n", "force_gain_error", "force_zero_n", "force_gain_std", "force_zero_std_n"});
  if (s.has("compression_m") && s.has("compression_strain"))
    throw TissueError("probe.compression_strain: give it or compression_m, not both");
  s.read("width_m", probe.width_m);
  s.read_count("lines", probe.lines);
  s.read("elevation_m", probe.elevation_m);
  probe.compression_m = .01 * depth_m;
  s.read("compression_m", probe.compression_m);
  double strain = probe.compression_m / depth_m;
  s.read("compression_strain", strain);
  if (s.has("compression_strain")) probe.compression_m = strain * depth_m;
  s.read("force_noise_relative", probe.force_noise_relative);
  s.read("force_noise_n", probe.force_noise_n);
  s.read("force_gain_error", probe.force_gain_error);
  s.read("force_zero_n", probe.force_zero_n);
  s.read("force_gain_std", probe.force_gain_std);
  s.read("force_zero_std_n", probe.force_zero_std_n);
}

void read_ultrasound(const Section& s, Ultrasound& u) {
  s.only({"center_frequency_hz", "bandwidth", "sampling_frequency_hz", "sound_speed_m_s", "f_number",
          "snr_db", "correlation", "depth_m", "elevation_beam_m", "focus_m", "beam_growth",
          "attenuation_db_cm_mhz"});
  s.read("center_frequency_hz", u.center_frequency_hz);
  s.read("bandwidth", u.bandwidth);
  s.read("sampling_frequency_hz", u.sampling_frequency_hz);
  s.read("sound_speed_m_s", u.sound_speed_m_s);
  s.read("f_number", u.f_number);
  s.read("snr_db", u.snr_db);
  s.read("correlation", u.correlation);
  s.read("depth_m", u.depth_m);
  s.read("elevation_beam_m", u.elevation_beam_m);
  s.read("focus_m", u.focus_m);
  s.read("beam_growth", u.beam_growth);
  s.read("attenuation_db_cm_mhz", u.attenuation_db_cm_mhz);
}

Solid read_solid(const Section& s) {
  s.only({"elevational_width_m", "support", "bed_depth_m", "bed_modulus_pa", "friction", "uneven",
          "preload_m", "lean_m", "capsule_m", "capsule_contrast", "bottom_contrast", "texture",
          "texture_length_m"});
  Solid solid;
  s.read("elevational_width_m", solid.elevational_width_m);
  solid.support = static_cast<Support>(
      s.word("support", {name_of(Support::kBonded), name_of(Support::kSliding), name_of(Support::kBed)}, 0));
  s.read("bed_depth_m", solid.bed_depth_m);
  s.read("bed_modulus_pa", solid.bed_modulus_pa);
  s.read_boundless("friction", solid.friction);
  s.read("uneven", solid.uneven);
  s.read("preload_m", solid.preload_m);
  s.read("lean_m", solid.lean_m);
  s.read("capsule_m", solid.capsule_m);
  s.read("capsule_contrast", solid.capsule_contrast);
  s.read("bottom_contrast", solid.bottom_contrast);
  s.read("texture", solid.texture);
  s.read("texture_length_m", solid.texture_length_m);
  return solid;
}

Tissue tissue_of(const toml::table& file) {
  const Section root(file, "");
  root.only({"seed", "tissue", "inclusion", "probe", "ultrasound", "solid"});
  Tissue t;
  root.read_count("seed", t.seed);
  const Section body = root.table("tissue");
  body.only({"width_m", "depth_m", "youngs_modulus_pa", "poisson_ratio", "thickness_m"});
  body.read("width_m", t.width_m);
  body.read("depth_m", t.depth_m);
  body.read("youngs_modulus_pa", t.youngs_modulus_pa);
  body.read("poisson_ratio", t.poisson_ratio);
  body.read("thickness_m", t.thickness_m);
  if (const toml::array* list = root.array("inclusion"))
    for (std::size_t i = 0; i < list->size(); ++i) t.inclusions.push_back(read_inclusion((*list)[i], i));
  read_probe(root.table("probe"), t.depth_m, t.probe);
  read_ultrasound(root.table("ultrasound"), t.ultrasound);
  if (root.has("solid")) t.solid = read_solid(root.table("solid"));
  validate(t);
  return t;
}

// The shortest digits that read back as the same number.
std::string digits(double value) {
  std::array<char, 32> text;
  return {text.data(), std::to_chars(text.data(), text.data() + text.size(), value).ptr};
}

}  // namespace

Tissue parse_tissue(const std::string& text, const std::string& name) {
  try {
    return tissue_of(toml::parse(text, name));
  } catch (const toml::parse_error& error) {
    std::ostringstream out;
    out << name << ":" << error.source().begin.line << ": " << error.description() << "; correct the TOML";
    throw TissueError(out.str());
  } catch (const TissueError& error) {
    throw TissueError(name + ": " + error.what());
  }
}

Tissue read_tissue(const std::filesystem::path& path) {
  constexpr std::size_t kLargestFileBytes = 1 << 20;
  if (readable_file_size(path) > kLargestFileBytes)
    throw FileError(path, "is larger than 1 MiB: no tissue file");
  std::ifstream in(path, std::ios::binary);
  std::stringstream text;
  text << in.rdbuf();
  return parse_tissue(text.str(), path.string());
}

void write_tissue(const std::filesystem::path& path, const Tissue& t) {
  std::string out = "# A simulated patient; lengths in metres, moduli in Pa.\n";
  const auto section = [&](const std::string& header) { out += "\n" + header + "\n"; };
  const auto key = [&](const char* name, double value) {
    out += std::string(name) + " = " + digits(value) + "\n";
  };
  out += "seed = " + std::to_string(t.seed) + "\n";
  section("[tissue]");
  key("width_m", t.width_m);
  key("depth_m", t.depth_m);
  key("youngs_modulus_pa", t.youngs_modulus_pa);
  key("poisson_ratio", t.poisson_ratio);
  key("thickness_m", t.thickness_m);
  for (const Inclusion& i : t.inclusions) {
    section("[[inclusion]]");
    out += "position_m = [" + digits(i.x_m) + ", " + digits(i.y_m) + (t.solid ? ", " + digits(i.z_m) : "") +
           "]\n";
    if (t.solid) out += std::string("shape = \"") + (i.sphere ? "sphere" : "cylinder") + "\"\n";
    key("diameter_m", i.diameter_m);
    key("contrast", i.contrast);
  }
  section("[probe]");
  key("width_m", t.probe.width_m);
  out += "lines = " + std::to_string(t.probe.lines) + "\n";
  key("elevation_m", t.probe.elevation_m);
  key("compression_m", t.probe.compression_m);
  key("force_noise_relative", t.probe.force_noise_relative);
  key("force_noise_n", t.probe.force_noise_n);
  key("force_gain_error", t.probe.force_gain_error);
  key("force_zero_n", t.probe.force_zero_n);
  key("force_gain_std", t.probe.force_gain_std);
  key("force_zero_std_n", t.probe.force_zero_std_n);
  section("[ultrasound]");
  key("center_frequency_hz", t.ultrasound.center_frequency_hz);
  key("bandwidth", t.ultrasound.bandwidth);
  key("sampling_frequency_hz", t.ultrasound.sampling_frequency_hz);
  key("sound_speed_m_s", t.ultrasound.sound_speed_m_s);
  key("f_number", t.ultrasound.f_number);
  key("snr_db", t.ultrasound.snr_db);
  key("correlation", t.ultrasound.correlation);
  key("depth_m", t.ultrasound.depth_m);
  key("elevation_beam_m", t.ultrasound.elevation_beam_m);
  key("focus_m", t.ultrasound.focus_m);
  key("beam_growth", t.ultrasound.beam_growth);
  key("attenuation_db_cm_mhz", t.ultrasound.attenuation_db_cm_mhz);
  if (t.solid) {
    const Solid& s = *t.solid;
    section("[solid]");
    key("elevational_width_m", s.elevational_width_m);
    out += std::string("support = \"") + name_of(s.support) + "\"\n";
    key("bed_depth_m", s.bed_depth_m);
    key("bed_modulus_pa", s.bed_modulus_pa);
    key("friction", s.friction);
    key("uneven", s.uneven);
    key("preload_m", s.preload_m);
    key("lean_m", s.lean_m);
    key("capsule_m", s.capsule_m);
    key("capsule_contrast", s.capsule_contrast);
    key("bottom_contrast", s.bottom_contrast);
    key("texture", s.texture);
    key("texture_length_m", s.texture_length_m);
  }
  write_file(path, out);
}

}  // namespace teletact::client
