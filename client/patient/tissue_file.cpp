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
  s.only({"position_m", "diameter_m", "contrast"});
  for (const char* key : {"position_m", "diameter_m", "contrast"})
    if (!s.has(key)) throw TissueError(s.prefix() + key + ": is missing; add it");
  const toml::array& position = *s.array("position_m");
  const auto x = position.size() == 2 ? position[0].value<double>() : std::nullopt;
  const auto y = position.size() == 2 ? position[1].value<double>() : std::nullopt;
  if (!x || !y) throw TissueError(s.prefix() + "position_m: must be two numbers [x, y]");
  Inclusion inclusion{*x, *y, 0, 1};
  s.read("diameter_m", inclusion.diameter_m);
  s.read("contrast", inclusion.contrast);
  return inclusion;
}

void read_probe(const Section& s, double depth_m, Probe& probe) {
  s.only({"width_m", "lines", "elevation_m", "compression_m", "compression_strain", "force_noise_relative",
          "force_noise_n"});
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
}

void read_ultrasound(const Section& s, Ultrasound& u) {
  s.only({"center_frequency_hz", "bandwidth", "sampling_frequency_hz", "sound_speed_m_s", "f_number",
          "snr_db", "correlation"});
  s.read("center_frequency_hz", u.center_frequency_hz);
  s.read("bandwidth", u.bandwidth);
  s.read("sampling_frequency_hz", u.sampling_frequency_hz);
  s.read("sound_speed_m_s", u.sound_speed_m_s);
  s.read("f_number", u.f_number);
  s.read("snr_db", u.snr_db);
  s.read("correlation", u.correlation);
}

Tissue tissue_of(const toml::table& file) {
  const Section root(file, "");
  root.only({"seed", "tissue", "inclusion", "probe", "ultrasound"});
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
    out += "position_m = [" + digits(i.x_m) + ", " + digits(i.y_m) + "]\n";
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
  section("[ultrasound]");
  key("center_frequency_hz", t.ultrasound.center_frequency_hz);
  key("bandwidth", t.ultrasound.bandwidth);
  key("sampling_frequency_hz", t.ultrasound.sampling_frequency_hz);
  key("sound_speed_m_s", t.ultrasound.sound_speed_m_s);
  key("f_number", t.ultrasound.f_number);
  key("snr_db", t.ultrasound.snr_db);
  key("correlation", t.ultrasound.correlation);
  write_file(path, out);
}

}  // namespace teletact::client
