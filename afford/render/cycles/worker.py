"""Render scene files with Cycles. Runs in the environment of Blender's module `bpy` and imports nothing of this project.

Reads one JSON object a line: {"scene": FILE.npz, "out": FILE.npy, "samples": int, "seed": int}. Writes the picture as (h, w, 3)
float16 linear RGB, then one line: {"out": FILE.npy}, or {"error": SENTENCE}.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
from pathlib import Path

import bpy
import numpy as np

FIRST, SECOND, PRODUCT = 6, 7, 2
"""sockets of the node Mix for colours; its sockets for other types have the same names"""

MESH = ("vertices", "normals", "uv", "colour", "faces")


def main() -> None:
    """Answer requests until the input ends. What Blender prints goes to stderr."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    for line in sys.stdin:
        request = json.loads(line)
        try:
            with np.load(request["scene"], allow_pickle=False) as scene:
                build(scene)
            render(request["samples"], request["seed"], Path(request["out"]))
            answer = {"out": request["out"]}
        except Exception as error:  # the client raises it again
            answer = {"error": f"{type(error).__name__}: {error}"}
        answers.write(json.dumps(answer) + "\n")
        answers.flush()


def build(scene: np.lib.npyio.NpzFile) -> None:
    """Build the scene of a file in an empty Blender."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    looks = scene["looks"]
    images = [image_of(scene[f"image{k}"], f"image{k}") for k in range(int(scene["images"]))]
    materials = [material_of(look, images[int(look[8])]) for look in looks]
    for k, material in enumerate(scene["materials"]):
        vertices, normals, uv, colour, faces = (scene[f"{part}{k}"] for part in MESH)
        mesh_of(f"mesh{k}", vertices, normals, uv, colour, faces, materials[material])
    world_of(scene["sky"])
    for lamp in scene["lamps"]:
        lamp_of(lamp)
    camera_of(scene["K"], scene["T_world_cam"], scene["size"], scene["lens"])


def image_of(pixels: np.ndarray, name: str) -> bpy.types.Image:
    """Make an image of (h, w, 3) uint8 sRGB; texture coordinates have v = 0 at its first row."""
    height, width = pixels.shape[:2]
    image = bpy.data.images.new(name, width, height)
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., :3] = pixels.astype(np.float32) / 255  # v = 0 is the first row
    image.pixels.foreach_set(rgba.ravel())
    image.update()
    return image


def material_of(look: np.ndarray, image: bpy.types.Image) -> bpy.types.Material:
    """Make a material: tint (3), specular, roughness, bump, metal, skin, image, transmission, coat, saturation."""
    tint, (specular, roughness, bump, metal, skin) = look[:3], look[3:8]
    transmission, coat, saturation = look[9:12]
    material = bpy.data.materials.new("material")
    material.use_nodes = True
    nodes, link = material.node_tree.nodes, material.node_tree.links.new
    surface = nodes["Principled BSDF"]
    texture, colour = nodes.new("ShaderNodeTexImage"), nodes.new("ShaderNodeVertexColor")
    texture.image, colour.layer_name = image, "colour"
    painted, tinted = multiply(nodes), multiply(nodes)
    link(texture.outputs["Color"], painted.inputs[FIRST])
    link(colour.outputs["Color"], painted.inputs[SECOND])
    link(painted.outputs[PRODUCT], tinted.inputs[FIRST])
    tinted.inputs[SECOND].default_value = (*map(float, tint), 1.0)
    pale = nodes.new("ShaderNodeHueSaturation")
    pale.inputs["Saturation"].default_value = float(saturation)
    link(tinted.outputs[PRODUCT], pale.inputs["Color"])
    link(pale.outputs["Color"], surface.inputs["Base Color"])
    surface.inputs["Metallic"].default_value = float(metal)
    surface.inputs["Roughness"].default_value = float(roughness)
    surface.inputs["Specular IOR Level"].default_value = float(min(specular / 0.08, 1.0))
    surface.inputs["Transmission Weight"].default_value = float(transmission)
    surface.inputs["Coat Weight"].default_value = float(coat)
    if skin:
        surface.inputs["Subsurface Weight"].default_value = float(0.3 * skin)
        surface.inputs["Subsurface Radius"].default_value = (0.012, 0.005, 0.003)
    if bump:
        relief = nodes.new("ShaderNodeBump")
        relief.inputs["Strength"].default_value, relief.inputs["Distance"].default_value = float(min(bump, 1.0)), 0.002
        link(texture.outputs["Color"], relief.inputs["Height"])
        link(relief.outputs["Normal"], surface.inputs["Normal"])
    return material


def multiply(nodes: bpy.types.Nodes) -> bpy.types.Node:
    """Add a node that multiplies two colours, its inputs FIRST and SECOND; the product is its output PRODUCT."""
    node = nodes.new("ShaderNodeMix")
    node.data_type, node.blend_type = "RGBA", "MULTIPLY"
    node.inputs["Factor"].default_value = 1.0
    return node


def mesh_of(name: str, vertices: np.ndarray, normals: np.ndarray, uv: np.ndarray, colour: np.ndarray, faces: np.ndarray,
            material: bpy.types.Material) -> None:  # fmt: skip
    """Add a mesh with the normals, texture coordinates and colours of its vertices."""
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(len(vertices))
    mesh.vertices.foreach_set("co", vertices.astype(np.float32).ravel())
    mesh.loops.add(3 * len(faces))
    mesh.loops.foreach_set("vertex_index", faces.astype(np.int32).ravel())
    mesh.polygons.add(len(faces))
    mesh.polygons.foreach_set("loop_start", np.arange(0, 3 * len(faces), 3, dtype=np.int32))
    mesh.update(calc_edges=True)
    mesh.uv_layers.new(name="uv").data.foreach_set("uv", uv[faces.ravel()].astype(np.float32).ravel())
    rgba = np.concatenate([colour, np.ones((len(colour), 1))], axis=1).astype(np.float32)
    mesh.color_attributes.new("colour", "FLOAT_COLOR", "POINT").data.foreach_set("color", rgba.ravel())
    mesh.polygons.foreach_set("use_smooth", np.ones(len(faces), np.bool_))
    mesh.normals_split_custom_set_from_vertices(normals.astype(np.float32).tolist())
    mesh.materials.append(material)
    bpy.context.collection.objects.link(bpy.data.objects.new(name, mesh))


def world_of(sky: np.ndarray) -> None:
    """Light the scene by a map (h, w, 3) float32 of linear radiance, equirectangular, rows from the zenith."""
    height, width = sky.shape[:2]
    image = bpy.data.images.new("sky", width, height, float_buffer=True)
    image.colorspace_settings.name = "Linear Rec.709"
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., :3] = sky[::-1]
    image.pixels.foreach_set(rgba.ravel())
    image.update()
    world = bpy.data.worlds.new("world")
    bpy.context.scene.world, world.use_nodes = world, True
    nodes = world.node_tree.nodes
    texture = nodes.new("ShaderNodeTexEnvironment")
    texture.image = image
    world.node_tree.links.new(texture.outputs["Color"], nodes["Background"].inputs["Color"])


def lamp_of(lamp: np.ndarray) -> None:
    """Add a square lamp: place (3), target (3), side (m), RGB power (3, W)."""
    from mathutils import Vector

    power = lamp[7:10]
    data = bpy.data.lights.new("lamp", "AREA")
    data.size, data.energy = float(lamp[6]), float(power.max())
    data.color = tuple(float(v) for v in power / power.max())
    place = bpy.data.objects.new("lamp", data)
    place.location = lamp[:3].tolist()
    place.rotation_euler = Vector((lamp[3:6] - lamp[:3]).tolist()).to_track_quat("-Z", "Y").to_euler()
    bpy.context.collection.objects.link(place)


def camera_of(K: np.ndarray, T_world_cam: np.ndarray, size: np.ndarray, lens: np.ndarray) -> None:
    """Add the pinhole camera; `lens` is the distance of the focus (m) and the f-number, 0 for a sharp picture."""
    from mathutils import Matrix

    width, height = map(int, size)
    data = bpy.data.cameras.new("camera")
    data.sensor_fit, data.angle = "HORIZONTAL", float(2 * np.arctan(0.5 * width / K[0, 0]))
    data.clip_start = 0.01
    if lens[1] > 0:
        data.dof.use_dof, data.dof.focus_distance, data.dof.aperture_fstop = True, float(lens[0]), float(lens[1])
    camera = bpy.data.objects.new("camera", data)
    camera.matrix_world = Matrix((T_world_cam @ np.diag([1.0, -1, -1, 1])).tolist())
    bpy.context.collection.objects.link(camera)
    scene = bpy.context.scene
    scene.camera = camera
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = width, height, 100


def render(samples: int, seed: int, out: Path) -> None:
    """Render the scene on one thread and save its linear RGB."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.samples, scene.cycles.seed = "CPU", samples, seed
    scene.cycles.use_denoising, scene.cycles.denoiser = True, "OPENIMAGEDENOISE"
    scene.cycles.denoising_prefilter, scene.cycles.denoising_quality = "FAST", "BALANCED"
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.max_bounces, scene.cycles.sample_clamp_indirect = 8, 4.0
    scene.render.threads_mode, scene.render.threads = "FIXED", 1
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth, scene.render.image_settings.color_mode = "32", "RGB"
    with tempfile.TemporaryDirectory() as folder:
        scene.render.filepath = str(Path(folder) / "picture.exr")
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(scene.render.filepath)
        width, height = image.size
        rgba = np.empty(4 * width * height, np.float32)
        image.pixels.foreach_get(rgba)
    linear = rgba.reshape(height, width, 4)[::-1, :, :3]
    np.save(out, np.clip(linear, 0, 6e4).astype(np.float16))


if __name__ == "__main__":
    main()
