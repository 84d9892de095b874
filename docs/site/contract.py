"""The contract's reference, as Markdown: out of what protoc says of the protos and of the comments in them."""

import re
import subprocess
import tempfile

from google.protobuf import descriptor_pb2

FIELD = descriptor_pb2.FieldDescriptorProto


def described(folder):
    """FileDescriptorSet of every proto under `folder`, comments included. Raises where protoc takes one not."""
    protos = sorted(str(proto.relative_to(folder)) for proto in folder.rglob("*.proto"))
    with tempfile.NamedTemporaryFile() as file:
        subprocess.run(["protoc", "-I", str(folder), "--include_source_info", f"--descriptor_set_out={file.name}",
                        *protos], check=True)
        return descriptor_pb2.FileDescriptorSet.FromString(file.read())


def page(files, name):
    """Markdown of the proto called `name` (as imports call it) of a FileDescriptorSet."""
    return "\n\n".join(part for part in Page(files, name).parts if part) + "\n"


class Page:
    def __init__(self, files, name):
        self.file = next(file for file in files.file if file.name == name)
        self.homes = {full: file.name for file in files.file for full in names_in(file)}
        self.places = {tuple(place.path): place for place in self.file.source_code_info.location}
        self.level = "##"
        about = self.places.get((12,))  # of the line `syntax`: the comment above it is the file's
        self.parts = [f"# {name.rsplit('/')[-1]}", plain(about.leading_comments) if about else "",
                      f"Package `{self.file.package}`, in `proto/{name}`."]
        things = [((6, i), service, self.service) for i, service in enumerate(self.file.service)]
        things += [((4, i), message, self.message) for i, message in enumerate(self.file.message_type)]
        things += [((5, i), enum, self.enum) for i, enum in enumerate(self.file.enum_type)]
        for path, thing, write in sorted(things, key=lambda one: list(self.places[one[0]].span)):
            self.section(path)
            write(path, thing, thing.name)

    def section(self, path):
        """A line `// --- scenes ---` begins a section."""
        for comment in self.places[path].leading_detached_comments:
            title = re.match(r"\s*-{3,} (.*?) -{3,}", comment)
            if title:
                self.level = "###"
                self.parts += ["## " + title[1][0].upper() + title[1][1:]]
            else:
                self.parts += [plain(comment)]

    def service(self, path, service, name):
        self.parts += [f"{self.level} {name}", self.said(path)]
        for i, method in enumerate(service.method):
            given, back = (("stream " if streams else "") + self.type_name(name)
                           for name, streams in ((method.input_type, method.client_streaming),
                                                 (method.output_type, method.server_streaming)))
            self.parts += [f"{self.level}# {name}.{method.name}", f"Takes {given} and returns {back}.", self.said((*path, 2, i))]

    def message(self, path, message, name):
        self.parts += [f"{self.level} {name}", self.said(path)]
        rows = []
        for i, field in enumerate(message.field):
            if field.HasField("oneof_index") and not field.proto3_optional:
                lead = f"one of `{message.oneof_decl[field.oneof_index].name}`. "
            else:
                lead = ""
            rows.append(f"| `{field.name}` | {field.number} | {self.field_type(field)} "
                        f"| {lead}{self.said((*path, 2, i), ' ')} |")
        head = "| field | number | type | meaning |\n|---|---|---|---|\n"
        self.parts += [head + "\n".join(rows) if rows else "It has no fields."]
        for i, oneof in enumerate(message.oneof_decl):
            said = self.said((*path, 8, i), " ")
            self.parts += [f"`{oneof.name}`: {said}"] if said else []
        for i, enum in enumerate(message.enum_type):
            self.enum((*path, 4, i), enum, f"{name}.{enum.name}")
        for i, inner in enumerate(message.nested_type):
            self.message((*path, 3, i), inner, f"{name}.{inner.name}")

    def enum(self, path, enum, name):
        rows = [f"| `{value.name}` | {value.number} | {self.said((*path, 2, i), ' ')} |" for i, value in enumerate(enum.value)]
        self.parts += [f"{self.level} {name}", self.said(path),
                       "| value | number | meaning |\n|---|---|---|\n" + "\n".join(rows)]

    def field_type(self, field):
        name = self.type_name(field.type_name) if field.type_name else FIELD.Type.Name(field.type)[5:].lower()
        if field.label == FIELD.LABEL_REPEATED:
            return f"repeated {name}"
        return f"optional {name}" if field.proto3_optional else name

    def type_name(self, full):
        """`.teletact.v1.Scene`: a link to where it stands."""
        home = self.homes.get(full)
        short = full.removeprefix(f".{self.file.package}.")
        if home is None:
            return f"`{short}`"
        return f"[`{short}`]({home.rsplit('/')[-1]}#{short.replace('.', '').lower()})"

    def said(self, path, between="\n\n"):
        """The comments above a thing and behind it."""
        place = self.places.get(path)  # the oneof of an `optional` has none
        comments = (place.leading_comments, place.trailing_comments) if place else ()
        return between.join(plain(comment, between) for comment in comments if comment)


def names_in(file):
    def inside(prefix, messages, enums):
        for enum in enums:
            yield f"{prefix}.{enum.name}"
        for message in messages:
            yield f"{prefix}.{message.name}"
            yield from inside(f"{prefix}.{message.name}", message.nested_type, message.enum_type)
    yield from inside(f".{file.package}", file.message_type, file.enum_type)


def plain(comment, between="\n\n"):
    """A comment's paragraphs. One begins at an empty line and where lines begin to stand further in; among those, a
    line that starts with a status and what it means is an item of a list."""
    paragraphs, further = [[]], False
    for line in comment.rstrip("\n").split("\n"):
        line = line.removeprefix(" ")
        item = re.match(r"  ([A-Z_]{6,}) +(?=[a-z])", line)
        if not line.strip() or item or line.startswith("  ") != further:
            paragraphs.append([])
        further = line.startswith("  ")
        if item:
            paragraphs[-1].append(f"- `{item[1]}`: {escaped(line[item.end():])}")
        elif line.strip():
            paragraphs[-1].append(escaped(line.strip()))
    return between.join(" ".join(paragraph) for paragraph in paragraphs if paragraph)


def escaped(line):
    """Names are code, and nothing else in a comment is Markdown but what stands between backticks."""
    parts = re.split(r"(`[^`]+`|[A-Za-z][\w.]*_\w+)", line)
    parts[::2] = [re.sub(r"([\\`*_\[\]<>|#])", r"\\\1", part) for part in parts[::2]]
    parts[1::2] = ["`" + part.strip("`").replace("|", "\\|") + "`" for part in parts[1::2]]
    return "".join(parts)
