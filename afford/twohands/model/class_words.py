"""Words of tasks -> classes of ImageNet that show such a thing, so that a classifier of photographs can point at what is named.

A thing without a class of its own (scissors, a fork) has none here; the model then has the words alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache, lru_cache

from afford.models.word_vectors import split_words

THINGS = 2
"""things of a task that are looked for, in the order of its words"""
KEPT = 4096
"""tasks whose things are remembered"""
CLASSES: dict[tuple[int, ...], str] = {
    # drinking and pouring
    (968, 504, 967): "cup mug teacup", (504, 441): "tankard", (572, 441, 966): "glass goblet tumbler wineglass flute",
    (438, 647): "beaker", (849,): "teapot", (849, 505): "kettle", (505,): "coffeepot",
    (725, 899, 901, 505): "jug pitcher carafe creamer", (440, 907, 737, 898): "bottle", (898, 503): "flask thermos",
    (720, 631, 838, 898): "shampoo detergent sunscreen", (631, 838): "lotion", (737, 440): "ketchup vinegar",
    (737, 503): "can tin soda cola beer", (653,): "churn", (585, 838): "hairspray spray", (720, 503): "jar canister",
    (720,): "pill pills medicine", (804, 631): "soap", (711,): "perfume", (647,): "measuring",
    # boxes and bags
    (478, 692): "carton packet parcel cereal package", (478, 692, 492, 519): "box case container", (519, 492): "crate chest",
    (709,): "pencilcase", (549,): "envelope letter", (748, 728): "bag", (748, 893): "purse handbag", (893,): "wallet",
    (414,): "backpack rucksack", (790, 588): "basket hamper", (463, 756): "bucket pail", (412,): "bin trash dustbin",
    (876, 463): "tub", (427, 756): "barrel",
    # cooking
    (567, 909): "pan skillet griddle frypan", (909, 567): "wok", (544, 521, 469, 567): "saucepan casserole cooker",
    (469, 544): "cauldron", (544, 521, 469, 738): "pot", (923,): "plate dish saucer", (868,): "tray", (659, 809): "bowl",
    (828,): "colander strainer sieve", (499, 623): "knife cleaver dagger", (910, 618): "spoon teaspoon tablespoon scoop",
    (618, 910): "ladle", (813, 910): "spatula turner", (666,): "mortar pestle", (773,): "mill shaker grinder salt",
    (512,): "corkscrew", (473,): "opener", (891,): "waffle", (651,): "microwave", (859,): "toaster", (760,): "fridge refrigerator",
    (827,): "stove", (534,): "dishwasher", (550,): "espresso",
    # tools and cleaning
    (587,): "hammer mallet", (784,): "screwdriver", (740,): "drill", (596,): "hatchet axe", (491,): "chainsaw", (726,): "plane",
    (783,): "screw", (677,): "nail", (792,): "shovel spade", (606,): "iron", (462, 840): "broom", (840,): "mop swab",
    (696, 840): "brush", (696,): "paintbrush", (700, 434): "towel", (533, 434): "cloth dishcloth rag",
    (533, 591): "napkin handkerchief", (999,): "tissue", (731,): "plunger", (897,): "washer", (882,): "vacuum",
    (463, 738): "planter", (695, 507): "padlock lock", (626,): "lighter", (644,): "match matchstick", (470,): "candle",
    (846, 619): "lamp", (845,): "syringe", (589,): "hairdryer dryer", (629,): "lipstick",
    # desk
    (418, 563): "pen ballpoint marker", (709, 418): "pencil", (710,): "sharpener", (767,): "eraser rubber", (769,): "ruler",
    (921, 446, 917): "book notebook", (446,): "binder", (620, 681): "laptop", (508, 878): "keyboard", (673,): "mouse",
    (487, 590): "phone cellphone smartphone mobile", (528,): "telephone", (761,): "remote",
    (664, 851): "monitor screen tv television", (759, 732): "camera", (632,): "speaker loudspeaker", (650,): "microphone",
    (742,): "printer", (409, 892): "clock", (531,): "watch", (837, 836): "sunglasses spectacles", (447,): "binoculars",
    (633,): "magnifier loupe",
    # clothes, toys and sports
    (879,): "umbrella", (883,): "vase", (738,): "flowerpot", (721,): "pillow cushion", (750,): "blanket quilt", (806,): "sock",
    (770, 630): "shoe sneaker", (774,): "sandal", (515, 808): "hat", (658,): "glove mitten", (610,): "shirt", (608,): "jeans",
    (722, 852, 522, 574): "ball", (805,): "football", (430,): "basketball", (429,): "baseball", (890,): "volleyball",
    (752,): "racket", (850,): "teddy toy bear", (543, 422): "dumbbell", (402,): "guitar", (889,): "violin", (541,): "drum",
    # food
    (954,): "banana", (950,): "orange tangerine mandarin", (951,): "lemon lime", (948,): "apple", (952,): "fig",
    (949,): "strawberry", (953,): "pineapple", (957,): "pomegranate", (945,): "paprika capsicum",
    (943, 939): "cucumber zucchini courgette", (937,): "broccoli", (938,): "cauliflower", (936,): "cabbage lettuce",
    (947, 992): "mushroom", (987, 998): "corn", (942, 940, 941): "squash", (607, 942): "pumpkin", (930, 931): "bread baguette loaf",
    (931,): "bagel", (932,): "pretzel", (963,): "pizza", (934,): "hotdog", (933,): "burger cheeseburger", (928,): "icecream",
    (929,): "lollipop", (961,): "dough", (962,): "meatloaf",
    # furniture
    (493, 553): "drawer", (495, 648, 894): "cupboard cabinet", (894,): "wardrobe closet", (799,): "door", (896,): "sink basin",
    (559, 765): "chair", (455, 622): "lid",
}  # fmt: skip
"""classes -> words for things that look like them"""


SHOWN = tuple(sorted({one for classes in CLASSES for one in classes}))
"""all of these classes"""


@cache
def by_word() -> dict[str, tuple[int, ...]]:
    """Word -> positions of its classes in `SHOWN`."""
    return {word: tuple(map(SHOWN.index, classes)) for classes, words in CLASSES.items() for word in words.split()}


@lru_cache(KEPT)
def named_classes(task: str) -> tuple[tuple[int, ...], ...]:
    """Positions in `SHOWN` of the classes of the first `THINGS` different things with classes that a task names."""
    found = (by_word().get(form) for word in split_words(task) for form in base_forms(word))
    return tuple(dict.fromkeys(one for one in found if one))[:THINGS]


def base_forms(word: str) -> Iterator[str]:
    """Yield the word and what it may be a form of: cups, cup; cutting, cut; taking, take; poured, pour."""
    yield word
    for ending in ("s", "es", "ing", "ed", "d"):
        if word.endswith(ending) and len(word) > len(ending) + 2:
            stem = word.removesuffix(ending)
            yield stem
            if ending == "ing":
                yield f"{stem}e"
                if stem[-1] == stem[-2]:
                    yield stem[:-1]
