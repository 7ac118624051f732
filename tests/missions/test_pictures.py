"""Pictures of every kind become the floor that a viewer shows, or an error; none becomes another floor."""

import contextlib
import io
import struct
import zlib

import numpy as np
import pytest
from PIL import Image as Pillow

from mercator_design import seeds
from mercator_design.config.schema import FieldError
from mercator_design.missions.floor import Floor, Image
from mercator_design.missions.floor_kernels import colour_at
from mercator_design.missions.pictures import read_picture
from mercator_design.sim.labels import floor_labels


@pytest.fixture
def read(tmp_path):
    """Return the pixels of a file with these contents."""

    def pixels(data):
        (tmp_path / "picture").write_bytes(data)
        return read_picture(str(tmp_path / "picture"))

    return pixels


def png(depth, kind, row, **chunks):
    """A PNG of one row, which may have more than Pillow writes."""
    channels = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}[kind]
    header = struct.pack(">IIBBBBB", len(row) * 8 // (depth * channels), 1, depth, kind, 0, 0, 0)
    parts = {"IHDR": header, **chunks, "IDAT": zlib.compress(b"\0" + row), "IEND": b""}
    packed = [(name.encode(), data) for name, data in parts.items()]
    wrapped = [
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in packed
    ]
    return b"\x89PNG\r\n\x1a\n" + b"".join(wrapped)


def wide(*levels):
    return struct.pack(f">{len(levels)}H", *levels)


def saved(picture, kind, **options):
    file = io.BytesIO()
    picture.save(file, kind, **options)
    return file.getvalue()


NOISE = Pillow.fromarray(np.random.default_rng(1).integers(0, 256, (12, 9, 3), dtype=np.uint8))
GRAY, BLACK, WHITE = [127] * 3, [0] * 3, [255] * 3
PALETTE = bytes([10, 20, 30, 40, 50, 60, 70, 80, 90])


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (png(16, 0, wide(32767, 0, 65535, 100 * 257)), [GRAY, BLACK, WHITE, [100] * 3]),
        (b"P5 3 1 65535\n" + wide(32767, 0, 65535), [GRAY, BLACK, WHITE]),
        (b"P5 3 1 1000\n" + wide(498, 0, 1000), [GRAY, BLACK, WHITE]),
        (b"P2 3 1 1000\n498 0 1000\n", [GRAY, BLACK, WHITE]),
        (b"P5 2 1 100\n\x00\x64", [BLACK, WHITE]),
        (png(16, 2, wide(32767, 0, 65535)), [[127, 0, 255]]),
        (b"P6 1 1 65535\n" + wide(32767, 0, 65535), [[127, 0, 255]]),
        (b"P4 2 1\n\x80", [BLACK, WHITE]),
        (png(1, 0, b"\x55"), [BLACK, WHITE] * 4),
        (png(4, 0, b"\x0f"), [BLACK, WHITE]),
        (png(4, 3, b"\x02", PLTE=PALETTE), [[10, 20, 30], [70, 80, 90]]),
        (saved(Pillow.new("CMYK", (1, 1), (0, 255, 255, 0)), "JPEG"), [[255, 0, 0]]),
        (saved(Pillow.new("RGBA", (1, 1), (1, 2, 3, 255)), "PNG"), [[1, 2, 3]]),
    ],
    ids=lambda _: "",
)
def test_every_depth_keeps_its_levels(read, data, expected):
    assert read(data)[0].tolist() == expected


CLEAR = 0


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (png(16, 0, wide(300, 301, 65535), tRNS=wide(300)), [[1, 1, 1, CLEAR], [1, 1, 1, 255], [255] * 4]),
        (png(8, 0, b"\x07\x08", tRNS=wide(7)), [[7, 7, 7, CLEAR], [8, 8, 8, 255]]),
        (png(4, 0, b"\x78", tRNS=wide(7)), [[119, 119, 119, CLEAR], [136, 136, 136, 255]]),
        (png(2, 0, b"\x1b", tRNS=wide(1)), [[0, 0, 0, 255], [85, 85, 85, CLEAR], [170, 170, 170, 255], [255] * 4]),
        (png(1, 0, b"\x40", tRNS=wide(1)), [[0, 0, 0, 255], [255, 255, 255, CLEAR], *[[0, 0, 0, 255]] * 6]),
        (png(1, 0, b"\x40", tRNS=wide(0)), [[0, 0, 0, CLEAR], [255] * 4, *[[0, 0, 0, CLEAR]] * 6]),
        (png(8, 2, bytes(6) + b"\1\2\3", tRNS=wide(1, 2, 3)), [[0, 0, 0, 255], [0, 0, 0, 255], [1, 2, 3, CLEAR]]),
        (
            png(8, 3, b"\0\1\2", PLTE=PALETTE, tRNS=b"\x80\xff"),
            [[10, 20, 30, 128], [40, 50, 60, 255], [70, 80, 90, 255]],
        ),
        (png(8, 3, b"\0\1", PLTE=PALETTE, tRNS=b"\xff\x00"), [[10, 20, 30, 255], [40, 50, 60, CLEAR]]),
        (png(8, 4, b"\x09\x80"), [[9, 9, 9, 128]]),
        (png(16, 4, wide(32767, 32767)), [[127] * 4]),
        (png(8, 6, b"\1\2\3\4"), [[1, 2, 3, 4]]),
        (png(16, 6, wide(256, 512, 768, 1024)), [[1, 2, 3, 4]]),
    ],
    ids=lambda _: "",
)
def test_transparency_is_read_in_every_form(read, data, expected):
    assert read(data)[0].tolist() == expected


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("kind", ["PNG", "JPEG"])
def test_a_picture_is_turned_as_its_exif_data_says(read, kind, orientation):
    exif = Pillow.Exif()
    exif[0x0112] = orientation
    turned = {
        1: lambda pixels: pixels,
        2: np.fliplr,
        3: lambda pixels: np.rot90(pixels, 2),
        4: np.flipud,
        5: lambda pixels: pixels.transpose(1, 0, 2),
        6: lambda pixels: np.rot90(pixels, -1),
        7: lambda pixels: np.rot90(pixels, 2).transpose(1, 0, 2),
        8: np.rot90,
    }[orientation]
    plain = read(saved(NOISE, kind))
    assert read(saved(NOISE, kind, exif=exif)).tolist() == turned(plain).tolist()


def test_gray_of_16_bits_is_turned_too(read):
    exif = Pillow.Exif()
    exif[0x0112] = 3
    assert read(saved(Pillow.fromarray(np.array([[256, 512]], dtype=np.uint16)), "PNG", exif=exif))[
        0, :, 0
    ].tolist() == [2, 1]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"Pf 1 1 -1.0\n" + struct.pack("<f", 0.5), "expected whole numbers of 8 or 16 bits"),
        (saved(NOISE, "PNG", save_all=True, append_images=[NOISE.rotate(180)]), "found an animation of 2"),
        (png(16, 2, wide(1, 2, 3), tRNS=wide(1, 2, 3)), "found a transparent colour of 16 bits"),
    ],
    ids=lambda _: "",
)
def test_a_picture_that_would_be_another_floor_is_refused(read, data, message):
    with pytest.raises(FieldError, match=message):
        read(data)


def test_a_photo_with_a_preview_is_the_photo(read):
    photo = saved(NOISE, "MPO", save_all=True, append_images=[NOISE.resize((3, 3))])
    assert read(photo).tolist() == read(saved(NOISE, "JPEG")).tolist()


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "BMP", "PPM"])
def test_a_picture_that_is_cut_anywhere_is_whole_or_refused(read, kind):
    data = saved(NOISE, kind)
    whole = read(data).tolist()
    for end in range(0, len(data), 7):
        with contextlib.suppress(FieldError):
            assert read(data[:end]).tolist() == whole


@pytest.mark.parametrize("picture", [NOISE, NOISE.quantize(16)])
def test_damage_of_a_png_is_found(read, picture):
    data = saved(picture, "PNG")
    whole = read(data).tolist()
    for place in range(len(data)):
        damaged = bytearray(data)
        damaged[place] ^= 0x80
        with contextlib.suppress(FieldError):
            assert read(bytes(damaged)).tolist() == whole


class TestTransparentFloor:
    @pytest.fixture
    def image(self, tmp_path):
        """Clear, half opaque and opaque red."""
        pixels = np.array([[[255, 0, 0, 0], [255, 0, 0, 128], [255, 0, 0, 255]]], dtype=np.uint8)
        Pillow.fromarray(pixels).save(tmp_path / "floor.png")
        return Image(path=str(tmp_path / "floor.png"), size=(3.0, 1.0))

    def test_the_background_shows_through(self, image):
        floor = Floor(background="white", image=image).realise(seeds.generator(1, "floor"))
        seen = [colour_at(floor, x, 0.0) for x in (-1.0, 0.0, 1.0)]
        assert seen == [(255.0, 255.0, 255.0), (255.0, 127.0, 127.0), (255.0, 0.0, 0.0)]

    def test_what_is_hidden_gives_no_label(self, image, tmp_path):
        Pillow.fromarray(np.array([[[0, 0, 255, 0], [255, 0, 0, 255]]], dtype=np.uint8)).save(tmp_path / "floor.png")
        hidden = Image(path=str(tmp_path / "floor.png"), size=(3.0, 1.0))
        assert floor_labels(Floor(background="white", image=hidden)) == ("white", "red")

    def test_the_copy_in_a_run_folder_is_the_same_image(self, image, tmp_path):
        (tmp_path / "copy.png").write_bytes(image.png())
        copy = Image(path=str(tmp_path / "copy.png"), size=(3.0, 1.0))
        assert copy == image
        assert copy.pixels.tolist() == image.pixels.tolist()
