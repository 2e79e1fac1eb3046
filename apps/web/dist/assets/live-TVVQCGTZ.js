import{a,b,c}from"./chunk-4H3UZRLT.js";import"./chunk-4PUPWI7C.js";import"./chunk-XGKB5SVJ.js";export{c as Live,b as LiveFigures,a as WALL};
